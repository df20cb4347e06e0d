"""The picture of docs/curves.md: a ball of hair, cables, grass, a spring of wire.

usage: curves.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np

SIZE = (960, 300)
SPACING = 1.15


def hair(edit: hg.Edits, x: float) -> None:
    """Strands that hang from a ball, brushed to one side."""
    rng = np.random.default_rng(2)
    count = 6000
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    steps = np.linspace(0, 1, 5)[:, None]
    falls = np.array([0.12, 0.05, -0.25])
    points = normals[:, None] * (0.28 + 0.2 * steps) + falls * steps**2
    points += rng.normal(0, 0.012, points.shape) * steps
    radii = np.tile(np.linspace(0.0022, 0.0006, 5), count)
    strands = hg.smooth_curves(points.reshape(-1, 3), [5] * count, radii, tolerance=1e-3)
    edit.mesh("hair", **strands)
    edit.material("hair", base_color=(0.28, 0.12, 0.05), roughness=0.35, anisotropic=0.7)
    edit.mesh("head", **hg.shapes.sphere(0.28))
    edit.material("skin", base_color=(0.25, 0.14, 0.09))
    place = hg.Pose((x, 0, 0.5))
    edit.entity("head", mesh="head", material="skin", transform=place)
    edit.entity("hair", mesh="hair", material="hair", transform=place)


def cables(edit: hg.Edits, x: float) -> None:
    colors = [(0.7, 0.05, 0.04), (0.03, 0.03, 0.035), (0.9, 0.7, 0.05), (0.04, 0.15, 0.6)]
    for i, color in enumerate(colors):
        t = np.linspace(0, 1, 9)[:, None]
        across = np.array([-0.45 + 0.3 * i, 0.3, 0.03])
        to = np.array([0.4 - 0.25 * i, -0.35, 0.03 + 0.02 * i])
        points = across + (to - across) * t + np.sin(2 * np.pi * (t + 0.2 * i)) * (0.12, 0, 0)
        points[:, 2] += 0.35 * np.sin(np.pi * t[:, 0]) ** 2
        cable = hg.smooth_curves(points, [9], 0.028, tolerance=2e-4)
        edit.mesh(f"cable{i}", **cable)
        edit.material(f"rubber{i}", base_color=color, roughness=0.35)
        place = hg.Pose((x, 0, 0))
        edit.entity(f"cable{i}", mesh=f"cable{i}", material=f"rubber{i}", transform=place)


def grass(edit: hg.Edits, x: float) -> None:
    rng = np.random.default_rng(4)
    count = 5000
    spots = rng.uniform(-1, 1, (count, 2))
    spots = spots[np.hypot(*spots.T) < 1] * 0.48
    count = len(spots)
    roots = np.column_stack([spots, np.zeros(count)])
    heights = rng.uniform(0.12, 0.34, (count, 1, 1))
    leans = rng.normal(0, 0.1, (count, 1, 3)) * (1, 1, -0.3)
    t = np.linspace(0, 1, 4)[None, :, None]
    points = roots[:, None] + heights * t * (0, 0, 1) + leans * t**2
    green = np.array([0.12, 0.32, 0.04]) * rng.uniform(0.6, 1.5, (count, 1, 3))
    edit.mesh(
        "grass",
        positions=points.reshape(-1, 3),
        curves=[4] * count,
        radii=np.tile([0.004, 0.0035, 0.0025, 0.0008], count),
        colors=np.broadcast_to(green, (count, 4, 3)).reshape(-1, 3).clip(0, 1),
    )
    edit.material("leaf", base_color=1.0, roughness=0.6)
    edit.entity("grass", mesh="grass", material="leaf", transform=hg.Pose((x, 0, 0)))


def spring(edit: hg.Edits, x: float) -> None:
    angle = np.linspace(0, 2 * np.pi * 7, 85)
    turns = np.stack([0.26 * np.cos(angle), 0.26 * np.sin(angle), 0.012 * angle + 0.05], -1)
    edit.mesh("spring", **hg.smooth_curves(turns, [len(turns)], 0.022, tolerance=1e-4))
    edit.material("steel", base_color=(0.6, 0.57, 0.5), metallic=1.0, roughness=0.15)
    edit.entity("spring", mesh="spring", material="steel", transform=hg.Pose((x, 0, 0)))


def build(edit: hg.Edits) -> hg.Entity:
    for i, make in enumerate((hair, cables, grass, spring)):
        make(edit, (i - 1.5) * SPACING)
    edit.mesh("floor", **hg.shapes.plane(400))
    edit.material("paper", base_color=0.4, roughness=0.9)
    edit.entity("floor", mesh="floor", material="paper")
    edit.sky(elevation=0.7, azimuth=-2.2)
    lens = hg.Camera.from_fov(36, *SIZE, degrees=True)
    return edit.entity("camera", camera=lens, transform=hg.look_at((0, -7, 2.2), (0, 0, 0.36)))


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("curves") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp)
        image = Image.fromarray(frame.image(exposure="auto", view="filmic"))
        image.convert("RGB").quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(
            out, optimize=True
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 64)
