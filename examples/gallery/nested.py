"""The picture of docs/materials.md on nested bodies: water and ice in a glass, three times.

usage: nested.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import heliograph as hg
import numpy as np
from heliograph import studio

SIZE = (480, 300)
WALL = 0.42  # inner radius of the glass
# Radius of the water, priorities of glass, water and ice.
CASES = (
    (WALL - 0.015, (0, 0, 0)),
    (WALL + 0.02, (0, 0, 0)),
    (WALL + 0.02, (2, 1, 3)),
)


def turned(profile: list[tuple[float, float]], segments: int = 128) -> dict[str, Any]:
    """The closed surface that (radius, height) points from axis to axis make, turned about +Z."""
    p = np.array(profile)
    phi = 2 * np.pi * np.arange(segments) / segments
    around = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    positions = np.empty((len(p), segments, 3), dtype="f4")
    positions[..., :2] = p[:, None, :1] * around
    positions[..., 2] = p[:, 1, None]
    i, j = np.mgrid[0 : len(p) - 1, 0:segments]
    a, b = i * segments + j, i * segments + (j + 1) % segments
    quads = np.stack([a, b, b + segments, a, b + segments, a + segments], axis=-1).reshape(-1, 3)
    corners = positions.reshape(-1, 3)[quads]
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return {
        "positions": positions.reshape(-1, 3),
        "indices": quads[np.linalg.norm(edges, axis=1) > 1e-9].astype("u4"),
    }


def tumbler() -> dict[str, Any]:
    """A glass with a wall of 6 cm and a rounded rim."""
    rim = [(WALL + 0.03 - 0.03 * np.cos(t), 1 + 0.03 * np.sin(t)) for t in np.linspace(np.pi, 0, 9)]
    return turned([(0, 0), (WALL + 0.06, 0), *rim, (WALL, 0.1), (0, 0.1)])


def build(edit: hg.Edits) -> hg.Entity:
    edit.dome(studio.dome())
    edit.material("table/material", base_color=(0.35, 0.3, 0.25), roughness=0.7)
    table = edit.mesh("table/mesh", **hg.shapes.plane(30))
    edit.entity("table", mesh=table, material="table/material")
    edit.material("straw/material", base_color=(0.7, 0.04, 0.03), roughness=0.4)
    straw = edit.mesh("straw/mesh", **hg.shapes.cylinder(0.035, 1.7))
    cube = edit.mesh("ice/mesh", **hg.shapes.cube(0.3))
    glass = edit.mesh("glass/mesh", **tumbler())
    for i, (radius, (of_glass, of_water, of_ice)) in enumerate(CASES):
        x = 1.25 * (i - 1)
        bottom = 0.1 - (radius - WALL)
        water = edit.mesh(
            f"{i}/water/mesh", **turned([(0, bottom), (radius, bottom), (radius, 0.78), (0, 0.78)])
        )
        edit.material(f"{i}/glass/material", **hg.materials.glass, priority=of_glass)
        edit.material(
            f"{i}/water/material",
            **{**hg.materials.glass, "ior": 1.33},
            attenuation_color=(0.75, 0.9, 0.95),
            attenuation_distance=0.8,
            priority=of_water,
        )
        edit.material(f"{i}/ice/material", **{**hg.materials.glass, "ior": 1.31}, priority=of_ice)
        at = hg.Pose((x, 0, 0))
        edit.entity(f"{i}/glass", mesh=glass, material=f"{i}/glass/material", transform=at)
        edit.entity(f"{i}/water", mesh=water, material=f"{i}/water/material", transform=at)
        for k, (dx, dy, turn) in enumerate(((-0.16, -0.1, 0.4), (0.14, 0.12, 1.1))):
            pose = hg.Pose((x + dx, dy, 0.7), euler=(0.2 + k, 0.3, turn))
            edit.entity(f"{i}/ice/{k}", mesh=cube, material=f"{i}/ice/material", transform=pose)
        pose = hg.Pose((x + 0.08, 0.1, 0.93), euler=(0, 0.28, 0))
        edit.entity(f"{i}/straw", mesh=straw, material="straw/material", transform=pose)
    lens = hg.Camera.from_fov(0.42, *SIZE)
    pose = hg.look_at((0, -8.5, 1.9), (0, 0, 0.62), (0, 0, 1))
    return edit.entity("camera", camera=lens, transform=pose)


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("nested") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=32, clamp_indirect=20)
        image = Image.fromarray(frame.image(view="filmic"))
        image.convert("RGB").quantize(192, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 256)
