"""Materials here. Run by materials_beside.py; side.py describes how."""

from __future__ import annotations

import os
import sys
from typing import Any

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import heliograph as hg
import materials
import numpy as np
import setting
import side


class Studio:
    """The ball in a scene that changes with every material and light."""

    def __init__(self, client: hg.Client) -> None:
        self.client, self.scene = client, client.create_scene()
        self.version = f"heliograph {client.info().version}"

    def prepare(self, row: materials.Row, light: str) -> side.PictureOf:
        self.scene.delete()
        self.scene = self.client.create_scene()
        setup = setting.LIGHTS[light]
        with self.scene.edit() as edit:
            self.add_ball(edit, row.ours, setup)
            self.add_lights(edit, setup, materials.core_scale(row, light))
        return self.picture

    def add_ball(self, edit: Any, given: materials.Values, light: setting.Light) -> None:
        edit.mesh("ball", **setting.ball(1, light.inside))
        edit.material("shown", **given)
        edit.material("black", base_color=0, specular=0)
        edit.entity("ball", mesh="ball", material="shown")
        scale = setting.SIZE / (2 * setting.HALF_VIEW)
        camera = hg.Camera.orthographic(scale, setting.SIZE, setting.SIZE)
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

    def picture(self, spp: int, seed: int) -> np.ndarray:
        frame = self.scene.render(
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


def main() -> None:
    with hg.connect(arguments=["--threads", "2"]) as client:
        studio = Studio(client)
        side.run("ours", studio.version, studio.prepare)


if __name__ == "__main__":
    main()
