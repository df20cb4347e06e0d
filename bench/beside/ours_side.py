"""Materials here. Run by materials_beside.py.

usage: ours_side.py SPP CHUNKS OUT.npz [NAME...]
"""

from __future__ import annotations

import os
import sys
from typing import Any

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import heliograph as hg
import materials
import numpy as np
import setting


class Studio:
    """The ball in a scene of its own for every picture."""

    def __init__(self, client: hg.Client) -> None:
        self.client = client
        self.version = f"heliograph {client.info().version}"

    def measure(
        self, row: materials.Row, light: str, spp: int, chunks: int
    ) -> dict[str, np.ndarray]:
        setup = setting.LIGHTS[light]
        with self.client.create_scene() as scene:
            with scene.edit() as edit:
                self.add_ball(edit, row.ours, setup)
                self.add_lights(edit, setup, materials.core_scale(row, light))
            return setting.measure(lambda seed: self.picture(scene, spp, seed), chunks)

    def add_ball(self, edit: Any, given: materials.Values, light: setting.Light) -> None:
        edit.mesh("ball", **setting.ball(1, light.inside))
        edit.material("shown", **given)
        edit.material("black", base_color=0, specular=0)
        edit.entity("ball", mesh="ball", material="shown")
        camera = hg.Camera.orthographic(
            setting.SIZE / (2 * setting.HALF_VIEW), setting.SIZE, setting.SIZE
        )
        edit.entity("camera", camera=camera, transform=setting.camera_pose())

    def add_lights(self, edit: Any, light: setting.Light, scale: float) -> None:
        if light.dome:
            edit.dome(color=light.dome)
        if light.lamp:
            edit.mesh("square", **hg.shapes.plane(setting.LAMP_SIDE))
            edit.entity(
                "lamp",
                mesh="square",
                material="black",
                transform=setting.lamp_pose(light.lamp),
                light=hg.Light(radiance=setting.LAMP_RADIANCE),
            )
        if light.core is not None:
            edit.mesh("core", **setting.ball(setting.CORE))
            glow = hg.Light(radiance=light.core * scale) if light.core else None
            edit.entity("core", mesh="core", material="black", light=glow)

    def picture(self, scene: hg.Scene, spp: int, seed: int) -> np.ndarray:
        frame = scene.render(
            "camera",
            spp=spp,
            seed=seed,
            planes=["beauty"],
            labels=False,
            max_depth=setting.MAX_DEPTH,
            roulette=False,
            filter="box",
            progress=False,
        )
        return np.array(frame["beauty"][..., :3])


def main(spp: int, chunks: int, out: str, names: list[str]) -> None:
    with hg.connect(arguments=["--threads", "2"]) as client:
        studio = Studio(client)
        found = {"version": np.array(studio.version)}
        for row, light in materials.pictures(names):
            measured = studio.measure(row, light, spp, chunks)
            for part, values in measured.items():
                found[f"{row.name}|{light}|{part}"] = values
            print(f"{row.name}, {light}", flush=True)
    np.savez(out, **found)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4:])
