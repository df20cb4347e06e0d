"""The picture of docs/materials.md on diffuse transmission and dispersion: rows of balls that vary
one parameter.

usage: leaves.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
from materials import Row, show, stripe_wall

COLUMNS = 7
SIZE = (420, 300)

PAPER = {"base_color": 0.85, "specular": 0.0, "thin_walled": True}
LEAF = {
    "base_color": (0.05, 0.2, 0.03),
    "roughness": 0.4,
    "diffuse_transmission_color": (0.45, 0.8, 0.08),
    "thin_walled": True,
}
WAX = {
    "base_color": 0.8,
    "roughness": 0.3,
    "diffuse_transmission": 0.9,
    "attenuation_color": (0.9, 0.35, 0.1),
}
CRYSTAL = {**hg.materials.glass, "base_color": 1.0, "roughness": 0.0, "ior": 1.6}

ROWS: tuple[tuple[str, Row], ...] = (
    ("paper", lambda t: {**PAPER, "diffuse_transmission": t}),
    ("leaf", lambda t: {**LEAF, "diffuse_transmission": t}),
    ("wax", lambda t: {**WAX, "attenuation_distance": 3.0 * 0.02**t}),
    ("dispersion", lambda t: {**CRYSTAL, "dispersion": 4 * t}),
    ("frosted", lambda t: {**CRYSTAL, "dispersion": 4.0, "roughness": 0.35 * t}),
)


def build(edit: hg.Edits) -> hg.Entity:
    stripe_wall(edit)
    return show(edit, ROWS, COLUMNS, SIZE)


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("leaves") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=12)
        Image.fromarray(frame.image(view="filmic")).convert("RGB").save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 256)
