"""The picture of docs/materials.md on interiors: rows of things that vary one parameter.

usage: interiors.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import heliograph as hg
import numpy as np
from heliograph import studio

COLUMNS = 5
SIZE = (320, 320)

FOG = {"base_color": 1.0, "transmission": 1.0, "roughness": 0.0, "ior": 1.0}

# Name, shape, parameters for t in [0, 1].
Row = tuple[str, str, Callable[[float], dict[str, Any]]]
ROWS: tuple[Row, ...] = (
    (
        "subsurface_radius",
        "torus",
        lambda t: {
            "subsurface": 1.0,
            "subsurface_color": (0.25, 0.62, 0.36),
            "subsurface_radius": 1e-3 * 300**t,
            "roughness": 0.2,
        },
    ),
    (
        "attenuation_distance",
        "torus",
        lambda t: {
            **hg.materials.glass,
            "attenuation_color": (0.7, 0.06, 0.04),
            "attenuation_distance": 2 * 0.025**t,
        },
    ),
    ("medium_density", "ball", lambda t: {**FOG, "medium_density": 0.3 * 100**t}),
    (
        "medium_anisotropy",
        "ball",
        lambda t: {**FOG, "medium_density": 4.0, "medium_anisotropy": 1.8 * t - 0.9},
    ),
    (
        "medium_albedo",
        "ball",
        lambda t: {
            **FOG,
            "ior": 1.33,
            "medium_density": (6.0, 8.0, 12.0),
            "medium_albedo": 0.5 + 0.5 * t,
        },
    ),
)


def build(edit: hg.Edits) -> hg.Entity:
    edit.dome(studio.dome())
    shapes = {
        "ball": edit.mesh("ball", **hg.shapes.sphere(0.42, 96)),
        "torus": edit.mesh("torus", **hg.shapes.torus(0.29, 0.14, 96)),
    }
    stripes = np.where(np.arange(16)[None, :, None] % 2 == 0, 0.6, 0.1)
    edit.texture("stripes", np.broadcast_to(stripes, (1, 16, 3)).astype("f4"), filter="nearest")
    edit.material("wall/material", base_color="stripes", roughness=0.8)
    wall = edit.mesh("wall/mesh", **hg.shapes.plane(9))
    turn = np.array([[1, 0, 0, 0], [0, 0, -1, 1.2], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    edit.entity("wall", mesh=wall, material="wall/material", transform=turn)
    for i, (name, shape, row) in enumerate(ROWS):
        for j in range(COLUMNS):
            material = edit.material(f"{name}/{j}/material", **row(j / (COLUMNS - 1)))
            at = (j - (COLUMNS - 1) / 2, 0, (len(ROWS) - 1) / 2 - i)
            pose = hg.Pose(at, euler=(0.9, 0.4, 0))
            edit.entity(f"{name}/{j}", mesh=shapes[shape], material=material, transform=pose)
    # Light from behind, between things and wall.
    lamp = edit.mesh("lamp/mesh", **hg.shapes.plane(1.6))
    edit.material("lamp/material", base_color=0)
    pose = hg.look_at((3.2, 0.9, 3.2), (0, 0, 0), (0, 0, 1))
    light = hg.Light(radiance=30, color=(1, 0.9, 0.75))
    turned = pose @ np.diag([1, -1, -1, 1.0])
    edit.entity("lamp", mesh=lamp, material="lamp/material", light=light, transform=turned)
    lens = hg.Camera.orthographic(SIZE[0] / COLUMNS, *SIZE)
    return edit.entity(
        "camera", camera=lens, transform=hg.look_at((0, -8, 0), (0, 0, 0), (0, 0, 1))
    )


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("interiors") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=64)
        image = Image.fromarray(frame.image(view="filmic"))
        image.convert("RGB").quantize(192, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 96)
