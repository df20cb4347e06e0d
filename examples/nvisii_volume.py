"""Clouds of arrays, as NViSII scripts make them: a swirl of smoke over a floor.

usage: nvisii_volume.py [--out FILE] [--size N] [--spp N] [--voxels N]
"""

import argparse

import numpy as np
import nvisii

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="nvisii_volume.png")
parser.add_argument("--size", type=int, default=360)
parser.add_argument("--spp", type=int, default=128)
parser.add_argument("--voxels", type=int, default=64)
opt = parser.parse_args()

nvisii.initialize(headless=True)
camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera"),
    camera=nvisii.camera.create("camera", 0.7),
)
camera.get_transform().look_at(at=(0, 0, 0.9), up=(0, 0, 1), eye=(0, -5, 1.6))
nvisii.set_camera_entity(camera)
nvisii.set_dome_light_intensity(0.6)
nvisii.set_max_bounce_depth(volume_depth=24)

floor = nvisii.entity.create(
    name="floor",
    mesh=nvisii.mesh.create_plane("floor", size=(8, 8)),
    transform=nvisii.transform.create("floor"),
    material=nvisii.material.create("floor", base_color=(0.3, 0.3, 0.32)),
)
light = nvisii.entity.create(
    name="light",
    mesh=nvisii.mesh.create_sphere("light", 0.3),
    transform=nvisii.transform.create("light", position=(3, -1, 4)),
    light=nvisii.light.create_from_temperature("light", 4000, 120),
)

n = opt.voxels
z, y, x = np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij")
angle = 5 * z
radius = np.hypot(x - 0.45 * np.cos(angle), y - 0.45 * np.sin(angle))
density = np.clip(1.6 - 4 * radius, 0, 1) * (0.6 + 0.4 * np.sin(40 * x) * np.sin(37 * y + 31 * z))
smoke = nvisii.volume.create_from_data(
    "smoke", width=n, height=n, depth=n, data=density.astype(np.float32).flatten(), background=0.0
)
smoke.set_scattering(0.9)
smoke.set_absorption(0.1)
smoke.set_scale(n / 64)
scale = 1.8 / n
nvisii.entity.create(
    name="smoke",
    volume=smoke,
    transform=nvisii.transform.create("smoke", scale=(scale,) * 3, position=(0, 0, 0.95)),
    material=nvisii.material.create("smoke", base_color=(0.9, 0.9, 0.95)),
)
nvisii.render_to_file(opt.size, opt.size, opt.spp, opt.out)
nvisii.deinitialize()
