"""The picture of docs/lights.md on portals: one room without and with them, at equal samples.

usage: portals.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np

TILE = (300, 240)
OUTDOORS = (-np.pi / 2, 0, 0)  # of a window in the +y wall: its z axis points to +y
WIDTH, HEIGHT = 0.7, 1.2
WINDOWS = (-0.75, 0.75)  # their x


def wall(edit: hg.Edits, name: str, low: tuple[float, ...], high: tuple[float, ...]) -> None:
    """A box between two corners."""
    at, size = np.add(low, high) / 2, np.subtract(high, low)
    pose = hg.Pose(at).matrix @ np.diag([*size, 1])
    edit.entity(name, mesh="box", material="paint", transform=pose)


def build(edit: hg.Edits) -> None:
    edit.mesh("box", **hg.shapes.cube(1))
    edit.material("paint", base_color=(0.75, 0.72, 0.66), roughness=0.7)
    edit.material("clay", base_color=(0.6, 0.25, 0.12), roughness=0.4)
    edit.sky(0.5, 1.9)
    edit.update("sun", visible=False)
    wall(edit, "floor", (-2.2, -2.2, -0.1), (2.2, 2.2, 0))
    wall(edit, "roof", (-2.2, -2.2, 2.6), (2.2, 2.2, 2.7))
    wall(edit, "left", (-2.2, -2.2, 0), (-2, 2.2, 2.6))
    wall(edit, "right", (2, -2.2, 0), (2.2, 2.2, 2.6))
    wall(edit, "back", (-2.2, -2.2, 0), (2.2, -2, 2.6))
    wall(edit, "sill", (-2, 2, 0), (2, 2.2, 0.9))
    wall(edit, "lintel", (-2, 2, 0.9 + HEIGHT), (2, 2.2, 2.6))
    edges = [-2, *(x + s * WIDTH / 2 for x in WINDOWS for s in (-1, 1)), 2]
    for i, (low, high) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        wall(edit, f"pier {i}", (low, 2, 0.9), (high, 2.2, 0.9 + HEIGHT))
    torus = edit.mesh("torus/mesh", **hg.shapes.torus(0.45, 0.18))
    ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.3))
    edit.entity("torus", mesh=torus, material="clay", transform=hg.Pose((0.5, 0.4, 0.18)))
    edit.entity("ball", mesh=ball, material="clay", transform=hg.Pose((-0.7, 0.8, 0.3)))
    camera = hg.Camera.from_fov(68, *TILE, degrees=True)
    edit.entity("camera", camera=camera, transform=hg.look_at((-1.6, -1.7, 1.5), (0.5, 1.2, 0.75)))


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene() as scene:
        with scene.edit() as edit:
            build(edit)
        with scene.overlay() as lit:
            for i, x in enumerate(WINDOWS):
                pose = hg.Pose((x, 2, 0.9 + HEIGHT / 2), euler=OUTDOORS)
                lit.entity(f"window {i}", portal=hg.Portal(WIDTH, HEIGHT), transform=pose)
        tiles = []
        for overlay in (None, lit):
            frame = scene.render("camera", spp=spp, overlay=overlay, max_depth=12)
            tiles.append(frame.image(exposure=1, view="filmic"))
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(tiles, axis=1)))
    image.quantize(256).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 48)
