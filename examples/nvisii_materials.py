"""A shelf of shapes with random materials under a picture of a studio, as NViSII scripts do it.

usage: nvisii_materials.py [--out FILE] [--width N] [--height N] [--spp N]
"""

import argparse
import colorsys
import random

import nvisii
from heliograph.datasets import bundled_domes

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="nvisii_materials.png")
parser.add_argument("--width", type=int, default=960)
parser.add_argument("--height", type=int, default=540)
parser.add_argument("--spp", type=int, default=256)
opt = parser.parse_args()

random.seed(11)
nvisii.initialize(headless=True, lazy_updates=True)
nvisii.set_max_bounce_depth(diffuse_depth=4, glossy_depth=8, transmission_depth=12)

camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera"),
    camera=nvisii.camera.create_from_fov("camera", 0.6, opt.width / opt.height),
)
camera.get_transform().look_at(at=(0, 0, 0.7), up=(0, 0, 1), eye=(0, -9, 3.2))
nvisii.set_camera_entity(camera)

dome = next(path for path in bundled_domes() if path.stem == "interior")
nvisii.set_dome_light_texture(nvisii.texture.create_from_file("dome", str(dome)), enable_cdf=True)
nvisii.set_dome_light_exposure(-1.3)
nvisii.set_dome_light_rotation(nvisii.angleAxis(nvisii.pi() * 1.2, (0, 0, 1)))

floor = nvisii.entity.create(
    name="floor",
    mesh=nvisii.mesh.create_plane("floor", size=(20, 20)),
    transform=nvisii.transform.create("floor"),
    material=nvisii.material.create("floor", base_color=(0.4, 0.38, 0.35), roughness=0.35),
)

meshes = [
    nvisii.mesh.create_sphere("sphere", 0.5, 64, 32),
    nvisii.mesh.create_torus_knot("knot", 2, 3, 24, 256),
    nvisii.mesh.create_teapotahedron("teapot", segments=16),
    nvisii.mesh.create_rounded_box("box", 0.1, (0.35, 0.35, 0.35), slices=8),
    nvisii.mesh.create_dodecahedron("dodecahedron", 0.55),
    nvisii.mesh.create_capsule("capsule", 0.3, 0.3),
]
sizes = {"knot": 0.33, "teapot": 0.28}

for row in range(3):
    for column in range(7):
        name = f"thing_{row}_{column}"
        mesh = meshes[(row * 7 + column) % len(meshes)]
        size = sizes.get(mesh.get_name(), 1.0)
        thing = nvisii.entity.create(
            name=name,
            mesh=mesh,
            transform=nvisii.transform.create(name, scale=(size, size, size)),
            material=nvisii.material.create(name),
        )
        thing.get_transform().set_angle_axis(random.uniform(-0.6, 0.6), (0, 0, 1))
        rise = -thing.get_min_aabb_corner()[2]
        thing.get_transform().set_position(((column - 3) * 1.25, (row - 1) * 1.8, rise))

        material = thing.get_material()
        rgb = colorsys.hsv_to_rgb(random.random(), random.uniform(0.4, 0.9), 0.9)
        material.set_base_color(rgb)
        material.set_roughness(random.uniform(0.05, 0.6))
        kind = random.choice(["plastic", "metal", "glass", "coat", "cloth", "wax"])
        if kind == "metal":
            material.set_metallic(1)
            material.set_anisotropic(random.random())
        elif kind == "glass":
            material.set_transmission(1)
            material.set_roughness(0)
            material.set_base_color((0.98, 0.99, 1.0))
        elif kind == "coat":
            material.set_clearcoat(1)
            material.set_roughness(0.8)
        elif kind == "cloth":
            material.set_sheen(1)
            material.set_roughness(1)
        elif kind == "wax":
            material.set_subsurface(1)
            material.set_subsurface_color(rgb)
            material.set_subsurface_radius((0.1, 0.05, 0.03))

nvisii.render_to_file(opt.width, opt.height, opt.spp, opt.out)
nvisii.deinitialize()
