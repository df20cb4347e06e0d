"""Motion blur and motion vectors, as NViSII scripts do them: a wheel that rolls past posts.

usage: nvisii_motion.py [--out DIR] [--width N] [--height N] [--spp N]
"""

import argparse
import os

import numpy as np
import nvisii
from PIL import Image

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="nvisii_motion")
parser.add_argument("--width", type=int, default=480)
parser.add_argument("--height", type=int, default=270)
parser.add_argument("--spp", type=int, default=128)
opt = parser.parse_args()
os.makedirs(opt.out, exist_ok=True)

nvisii.initialize(headless=True)
camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera"),
    camera=nvisii.camera.create("camera", 0.7, opt.width / opt.height),
)
camera.get_transform().look_at(at=[0, 0, 0.7], up=[0, 0, 1], eye=[0, -6, 1.6])
nvisii.set_camera_entity(camera)
nvisii.set_dome_light_intensity(1.5)

floor = nvisii.entity.create(
    name="floor",
    mesh=nvisii.mesh.create_plane("floor", size=(10, 10)),
    transform=nvisii.transform.create("floor"),
    material=nvisii.material.create("floor", base_color=(0.3, 0.35, 0.3)),
)
post_mesh = nvisii.mesh.create_capped_cylinder("post", 0.1, 0.7)
post_material = nvisii.material.create("post", base_color=(0.8, 0.7, 0.2))
for i in range(5):
    nvisii.entity.create(
        name=f"post_{i}",
        mesh=post_mesh,
        transform=nvisii.transform.create(f"post_{i}", position=(i * 1.5 - 3, 1, 0.7)),
        material=post_material,
    )

axle = nvisii.transform.create("axle", position=(0.2, 0, 0.7))
tire = nvisii.entity.create(
    name="tire",
    mesh=nvisii.mesh.create_torus("tire", 0.15, 0.55, 32, 64),
    transform=nvisii.transform.create("tire"),
    material=nvisii.material.create("tire", base_color=(0.05, 0.05, 0.06), roughness=0.8),
)
tire.get_transform().set_parent(axle)
for i in range(6):
    spoke = nvisii.entity.create(
        name=f"spoke_{i}",
        mesh=nvisii.mesh.create_line(f"spoke_{i}", (0, 0, 0), (0.5, 0, 0), radius=0.04),
        transform=nvisii.transform.create(f"spoke_{i}"),
        material=nvisii.material.create(f"spoke_{i}", base_color=(0.9, 0.2, 0.1), metallic=1),
    )
    spoke.get_transform().set_angle_axis(i * nvisii.pi() / 3, (0, 0, 1))
    spoke.get_transform().set_parent(axle)
axle.set_angle_axis(nvisii.pi() / 2, (1, 0, 0))

speed = 12.0  # a second
axle.set_linear_velocity((speed, 0, 0), frames_per_second=24)
axle.set_angular_velocity(nvisii.angleAxis(0.4 * 24 * 0.25, (0, 1, 0)), frames_per_second=6)

size = (opt.width, opt.height)
nvisii.sample_time_interval((0, 1))
nvisii.render_to_file(*size, opt.spp, os.path.join(opt.out, "blurred.png"))
nvisii.sample_time_interval((1, 1))
nvisii.render_to_file(*size, opt.spp, os.path.join(opt.out, "sharp.png"))

vectors = nvisii.render_data(*size, 0, 1, 0, "diffuse_motion_vectors")
vectors = np.flipud(np.array(vectors).reshape(opt.height, opt.width, 4))
np.save(os.path.join(opt.out, "motion.npy"), vectors[..., :2] * [opt.width, -opt.height])
shown = np.clip(0.5 + vectors[..., :3] * [6, 6, 0], 0, 1)
Image.fromarray((shown * 255).astype(np.uint8)).save(os.path.join(opt.out, "motion.png"))
nvisii.deinitialize()
