"""The picture of docs/materials.md on thin films: rows of balls that vary one parameter.

usage: iridescence.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from materials import Row, show

COLUMNS = 7
SIZE = (420, 300)

STEEL = {"base_color": 0.55, "metallic": 1.0, "roughness": 0.25, "iridescence": 1.0}
BUBBLE = {
    **hg.materials.glass,
    "thin_walled": True,
    "ior": 1.0,
    "iridescence": 1.0,
    "iridescence_ior": 1.33,
}

ROWS: tuple[tuple[str, Row], ...] = (
    (
        "thickness",
        lambda t: {**STEEL, "iridescence_ior": 2.2, "iridescence_thickness": 15 + 285 * t},
    ),
    (
        "ior",
        lambda t: {**STEEL, "iridescence_ior": 1 + 1.5 * t, "iridescence_thickness": 350},
    ),
    (
        "roughness",
        lambda t: {
            **STEEL,
            "base_color": 0.7,
            "iridescence_ior": 1.8,
            "iridescence_thickness": 450,
            "roughness": 0.9 * t,
        },
    ),
    (
        "iridescence",
        lambda t: {
            "base_color": 0.02,
            "roughness": 0.15,
            "iridescence": t,
            "iridescence_ior": 2.0,
            "iridescence_thickness": 330,
        },
    ),
    (
        "bubble",
        lambda t: {
            **BUBBLE,
            "iridescence_thickness": hg.Tex("drained", factor=150 + 750 * t, scale=0.6, offset=0.7),
        },
    ),
)


def drained(size: int = 256) -> np.ndarray:
    """(size, size) float32: a film that gets thicker downwards and has swirls."""
    y, x = np.mgrid[0:size, 0:size] / size
    swirl = np.sin(2 * np.pi * (3 * x + 0.7 * np.sin(2 * np.pi * (2 * x + 3 * y))) + 9 * y)
    return (y + 0.08 * swirl).astype("f4")


def build(edit: hg.Edits) -> hg.Entity:
    edit.texture("drained", drained())
    edit.material("wall/material", base_color=0.15, roughness=0.8)
    return show(edit, ROWS, COLUMNS, SIZE)


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("iridescence") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=8)
        Image.fromarray(frame.image(view="filmic")).convert("RGB").save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 256)
