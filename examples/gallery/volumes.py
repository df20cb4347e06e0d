"""The picture of docs/volumes.md: smoke, a cloud, fire, coloured mist, two fogs that overlap.

usage: volumes.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np

SIDE = 64
SIZE = (960, 300)
SPACING = 1.15


def axes(side: int = SIDE) -> list[np.ndarray]:
    """Three (side, side, side) arrays: x, y, z of the voxels' centres, in [-1, 1]."""
    line = (np.arange(side) + 0.5) / side * 2 - 1
    return list(np.meshgrid(line, line, line, indexing="ij"))


def noise(seed: int, octaves: int = 4, side: int = SIDE) -> np.ndarray:
    """(side, side, side) fractal value noise of mean 0, roughly in [-1, 1]."""
    random = np.random.default_rng(seed)
    at = np.arange(side) / side
    out = np.zeros((side,) * 3)
    for octave in range(octaves):
        cells = 4 << octave
        values = random.uniform(-1, 1, (cells + 1,) * 3)
        low = np.minimum((at * cells).astype(int), cells - 1)
        t = at * cells - low
        t = t * t * (3 - 2 * t)
        for axis in range(3):
            shape = [1, 1, 1]
            shape[axis] = side
            weight = t.reshape(shape)
            a, b = (np.take(values, low + i, axis) for i in (0, 1))
            values = a * (1 - weight) + b * weight
        out += values / 1.8**octave
    return out


def plume() -> np.ndarray:
    """Smoke that widens and thins out as it rises."""
    x, y, z = axes()
    height = (z + 1) / 2
    bend = 0.12 * np.sin(3 * height) * height
    radius = np.hypot(x - bend, y + 0.6 * bend) / (0.1 + 0.32 * height)
    shape = 1.05 - radius + 0.65 * noise(1) * (0.4 + height)
    return np.clip(3 * shape, 0, 1) * (1 - 0.75 * height) * np.clip(8 * (1 - height), 0, 1)


def cloud() -> np.ndarray:
    """Lumps over a flat base."""
    x, y, z = axes()
    lumps = ((0, 0, -0.1, 0.55), (0.45, 0.1, -0.25, 0.4), (-0.45, -0.1, -0.28, 0.42))
    distance = [np.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / r for a, b, c, r in lumps]
    shape = 1 - np.min(distance, axis=0) + 0.4 * noise(2)
    return np.clip(6 * shape, 0, 1) * np.clip(6 * (z + 0.62), 0, 1)


def fire() -> tuple[np.ndarray, np.ndarray]:
    """Density and temperature, kelvin, of a flame."""
    x, y, z = axes()
    height = (z + 1) / 2
    radius = np.hypot(x, y) / (0.5 * np.sqrt(height + 0.02) * (1.15 - height) + 1e-3)
    shape = np.clip(1.1 - radius + 0.8 * noise(3) * (0.3 + height), 0, 1)
    return np.clip(3 * shape, 0, 1), 900 + 1300 * np.clip(1.3 * shape, 0, 1) * (1 - 0.35 * height)


def ball() -> np.ndarray:
    x, y, z = axes()
    return np.clip(4 * (0.8 - np.sqrt(x * x + y * y + z * z)), 0, 1)


def fill(edit: hg.Edits) -> None:
    """Volumes in a row along x, each in a box of side 1 above the floor."""
    voxels = {"voxel_size": 1 / SIDE, "origin": (-0.5, -0.5, 0)}
    x, y, z = axes()
    mist = np.stack([0.5 + 0.5 * np.sin(4 * x + k * 2.1 + 2 * z) for k in range(3)], axis=-1)
    hot, kelvin = fire()
    edit.volume("smoke", density=plume(), density_scale=25, albedo=0.55, **voxels)
    edit.volume("cloud", density=cloud(), density_scale=40, albedo=0.995, anisotropy=0.6, **voxels)
    edit.volume(
        "fire", density=hot, temperature=kelvin, density_scale=9, albedo=0.1, emission_scale=0.12,
        **voxels,
    )  # fmt: skip
    edit.volume("mist", density=ball(), color=mist, density_scale=8, albedo=0.98, **voxels)
    edit.volume("fog", density=ball(), density_scale=5, albedo=(0.95, 0.35, 0.3), **voxels)
    edit.volume("haze", density=ball(), density_scale=5, albedo=(0.3, 0.45, 0.95), **voxels)
    for i, name in enumerate(("smoke", "cloud", "fire", "mist")):
        edit.entity(f"{name}/0", volume=name, transform=hg.Pose(((i - 2) * SPACING, 0, 0)))
    for name, shift in (("fog", -0.15), ("haze", 0.15)):
        pose = hg.Pose((2 * SPACING + shift, 0, 0.5 * shift + 0.12), scale=0.8)
        edit.entity(f"{name}/0", volume=name, transform=pose)


def build(edit: hg.Edits) -> hg.Entity:
    edit.sky(elevation=0.6, azimuth=2.4)
    edit.material("floor", base_color=0.25, roughness=0.8)
    edit.mesh("floor/mesh", **hg.shapes.plane(400))
    edit.entity("floor/entity", mesh="floor/mesh", material="floor")
    fill(edit)
    lens = hg.Camera.from_fov(48, *SIZE, degrees=True)
    return edit.entity("camera", camera=lens, transform=hg.look_at((0, -6.2, 1.8), (0, 0, 0.4)))


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("volumes") as scene:
        with scene.edit() as edit:
            camera = build(edit)
        frame = scene.render(camera, spp=spp, max_depth=48)
        image = Image.fromarray(frame.image(exposure="auto", view="filmic"))
        image.convert("RGB").quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(
            out, optimize=True
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 64)
