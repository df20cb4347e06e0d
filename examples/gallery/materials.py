"""The picture of docs/materials.md: rows of balls, each of which varies one parameter.

usage: materials.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import heliograph as hg
import numpy as np
from heliograph import studio

COLUMNS = 6
SIZE = (360, 420)

Row = Callable[[float], dict[str, Any]]
ROWS: tuple[tuple[str, Row], ...] = (
    ("roughness", lambda t: {**hg.materials.gold, "roughness": t}),
    (
        "anisotropic",
        lambda t: {"base_color": 0.7, "metallic": 1.0, "roughness": 0.4, "anisotropic": t},
    ),
    (
        "clearcoat",
        lambda t: {"base_color": (0.5, 0.03, 0.02), "roughness": 0.6, "clearcoat": t},
    ),
    (
        "sheen",
        lambda t: {"base_color": (0.02, 0.03, 0.12), "specular": 0.0, "sheen": t},
    ),
    (
        "transmission_roughness",
        lambda t: {**hg.materials.glass, "transmission_roughness": 0.8 * t},
    ),
    (
        "thin_walled",
        lambda t: {
            **hg.materials.glass,
            "base_color": (0.7, 0.9, 0.95),
            "thin_walled": True,
            "roughness": 0.8 * t,
        },
    ),
    (
        "bump_map",
        lambda t: {
            "base_color": (0.55, 0.5, 0.42),
            "roughness": 0.45,
            "bump_map": hg.Tex("dimples", scale=0.04 * t),
        },
    ),
)


def dimples(size: int = 512, count: int = 16) -> np.ndarray:
    """(size, size) float32 heights in [0, 1]: a grid of round dents."""
    y, x = np.mgrid[0:size, 0:size] * (count / size)
    return (0.5 - 0.5 * np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y)).astype("f4")


def show(
    edit: hg.Edits, rows: Sequence[tuple[str, Row]], columns: int, size: tuple[int, int]
) -> hg.Entity:
    """Balls of each row's materials before "wall/material", under studio lights; the camera."""
    edit.dome(studio.dome())
    ball = edit.mesh("ball", **hg.shapes.sphere(0.44, 96))
    wall = edit.mesh("wall/mesh", **hg.shapes.plane(9))
    turn = np.array([[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    edit.entity("wall", mesh=wall, material="wall/material", transform=turn)
    for i, (name, row) in enumerate(rows):
        for j in range(columns):
            material = edit.material(f"{name}/{j}/material", **row(j / (columns - 1)))
            at = (j - (columns - 1) / 2, 0, (len(rows) - 1) / 2 - i)
            edit.entity(f"{name}/{j}", mesh=ball, material=material, transform=hg.Pose(at))
    lens = hg.Camera.orthographic(size[0] / columns, *size)
    pose = hg.look_at((0, -8, 0), (0, 0, 0), (0, 0, 1))
    return edit.entity("camera", camera=lens, transform=pose)


def stripe_wall(edit: hg.Edits) -> None:
    """Makes "wall/material", whose stripes show through what is clear."""
    stripes = np.where(np.arange(16)[None, :, None] % 2 == 0, 0.75, 0.08)
    edit.texture("stripes", np.broadcast_to(stripes, (1, 16, 3)).astype("f4"), filter="nearest")
    edit.material("wall/material", base_color="stripes", roughness=0.8)


def build(edit: hg.Edits) -> hg.Entity:
    edit.texture("dimples", dimples())
    stripe_wall(edit)
    return show(edit, ROWS, COLUMNS, SIZE)


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("materials") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=8)
        image = Image.fromarray(frame.image(view="filmic"))
        image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 512)
