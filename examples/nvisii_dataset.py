"""A small data set as NViSII scripts make it: picture, ids, depth and JSON per frame.

usage: nvisii_dataset.py [--out DIR] [--frames N] [--size N] [--spp N]
"""

import argparse
import json
import os
import random

import numpy as np
import nvisii
from PIL import Image

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="nvisii_dataset")
parser.add_argument("--frames", type=int, default=4)
parser.add_argument("--size", type=int, default=256)
parser.add_argument("--spp", type=int, default=64)
opt = parser.parse_args()

os.makedirs(opt.out, exist_ok=True)
random.seed(2)
nvisii.initialize(headless=True)
camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera"),
    camera=nvisii.camera.create_from_intrinsics(
        "camera", fx=opt.size, fy=opt.size, cx=opt.size / 2 - 0.5, cy=opt.size / 2 - 0.5,
        width=opt.size, height=opt.size,
    ),
)  # fmt: skip
nvisii.set_camera_entity(camera)
nvisii.set_dome_light_sky(sun_position=(2, -4, 6), saturation=1.1)

lamp = nvisii.entity.create(
    name="lamp",
    mesh=nvisii.mesh.create_sphere("lamp", 0.2),
    transform=nvisii.transform.create("lamp"),
    light=nvisii.light.create("lamp"),
)

checker = np.indices((8, 8)).sum(axis=0) % 2
texels = np.stack([0.3 + 0.5 * checker, 0.3 + 0.3 * checker, 0.3 + 0.1 * checker], axis=-1)
texels = np.concatenate([texels, np.ones((8, 8, 1))], axis=-1).astype(np.float32)
wood = nvisii.texture.create_from_data("checker", 8, 8, texels.flatten())
floor = nvisii.entity.create(
    name="floor",
    mesh=nvisii.mesh.create_plane("floor", size=(4, 4)),
    transform=nvisii.transform.create("floor", position=(0, 0, -0.8)),
    material=nvisii.material.create("floor", roughness=0.5),
)
floor.get_material().set_base_color_texture(wood)

shapes = {
    "box": nvisii.mesh.create_box("box", (0.2, 0.3, 0.15)),
    "ball": nvisii.mesh.create_icosphere("ball", 0.25, 8),
    "cone": nvisii.mesh.create_capped_cone("cone", 0.2, 0.3),
    "ring": nvisii.mesh.create_torus("ring", 0.08, 0.25),
}
things = []
for i in range(8):
    kind = random.choice(sorted(shapes))
    name = f"{kind}_{i}"
    things.append(
        nvisii.entity.create(
            name=name,
            mesh=shapes[kind],
            transform=nvisii.transform.create(name),
            material=nvisii.material.create(name),
        )
    )

ids = nvisii.entity.get_name_to_id_map()
for frame in range(opt.frames):
    camera.get_transform().look_at(
        at=(0, 0, -0.2),
        up=(0, 0, 1),
        eye=(random.uniform(-1, 1), -3, random.uniform(0.5, 2)),
    )
    lamp.get_transform().set_position((random.uniform(-3, 3), -2, 3))
    lamp.get_light().set_temperature(random.uniform(2500, 9000))
    lamp.get_light().set_intensity(random.uniform(20, 80))
    for thing in things:
        axis = nvisii.sphericalRand(1.0)
        thing.get_transform().set_position([random.uniform(-0.8, 0.8) for _ in range(3)])
        thing.get_transform().set_rotation(nvisii.angleAxis(random.uniform(0, 3), axis))
        thing.get_material().set_base_color([random.random() for _ in range(3)])
        thing.get_material().set_roughness(random.random())
        thing.get_material().set_metallic(random.choice([0, 1]))

    stem = os.path.join(opt.out, f"{frame:05d}")
    nvisii.sample_pixel_area((0, 1), (0, 1))
    nvisii.render_to_file(opt.size, opt.size, opt.spp, stem + ".png", seed=frame)

    nvisii.sample_pixel_area((0.5, 0.5), (0.5, 0.5))
    seg = nvisii.render_data(opt.size, opt.size, 0, 1, 0, "entity_id")
    seg = np.array(seg).reshape((opt.size, opt.size, 4))
    seg = np.flipud(seg)[:, :, 0]
    nvisii.render_data_to_file(opt.size, opt.size, 0, 1, 0, "depth", stem + ".depth.exr")

    world_to_camera = np.array(camera.get_transform().get_world_to_local_matrix()).T
    k = np.array(camera.get_camera().get_intrinsic_matrix(opt.size, opt.size)).T
    objects = []
    for thing in things:
        rows, columns = np.nonzero(seg == ids[thing.get_name()])
        center = world_to_camera @ [*thing.get_transform().get_world_position(), 1]
        x, y, w = k @ (center[:3] * [1, -1, -1])  # OpenGL's axes to OpenCV's
        box = None
        if len(rows):
            box = [int(v) for v in (columns.min(), rows.min(), columns.max(), rows.max())]
        quaternion = thing.get_transform().get_rotation()
        objects.append(
            {
                "name": thing.get_name(),
                "bounding_box": box,
                "pixels": len(rows),
                "center_image": [x / w, y / w],
                "quaternion_xyzw": [quaternion[i] for i in range(4)],
                "position": list(thing.get_transform().get_position()),
            }
        )
    with open(stem + ".json", "w") as file:
        json.dump({"intrinsics": k.tolist(), "objects": objects}, file, indent=1)
    seen = np.where(seg < 1e6, seg + 1, 0)  # what is nothing is the largest float
    Image.fromarray((seen * 37 % 256).astype(np.uint8)).save(stem + ".seg.png")

nvisii.deinitialize()
