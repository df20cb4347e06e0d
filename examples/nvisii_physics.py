"""PyBullet drops things into a box, NViSII's interface shows them; colliders are read from meshes.

usage: nvisii_physics.py [--out FILE] [--objects N] [--steps N] [--size N] [--spp N]
"""

import argparse
import random

import numpy as np
import nvisii
import pybullet as p

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="nvisii_physics.png")
parser.add_argument("--objects", type=int, default=60)
parser.add_argument("--steps", type=int, default=700)
parser.add_argument("--size", type=int, default=480)
parser.add_argument("--spp", type=int, default=128)
opt = parser.parse_args()

random.seed(4)
nvisii.initialize(headless=True)
client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.8)

camera = nvisii.entity.create(
    name="camera",
    transform=nvisii.transform.create("camera"),
    camera=nvisii.camera.create("camera", 0.6),
)
camera.get_transform().look_at(at=(0, 0, 0.2), up=(0, 0, 1), eye=(3.4, -5.2, 5))
nvisii.set_camera_entity(camera)
nvisii.set_dome_light_intensity(1.2)


def add_body(entity, mass):
    mesh = entity.get_mesh()
    shape = p.createCollisionShape(
        p.GEOM_MESH,
        vertices=mesh.get_vertices(),
        **({} if mass else {"indices": list(mesh.get_triangle_indices())}),
    )
    x, y, z = entity.get_transform().get_position()
    q = entity.get_transform().get_rotation()
    return p.createMultiBody(mass, shape, basePosition=[x, y, z], baseOrientation=list(q))


floor = nvisii.entity.create(
    name="floor",
    mesh=nvisii.mesh.create_box("floor", (3, 3, 0.1)),
    transform=nvisii.transform.create("floor", position=(0, 0, -0.1)),
    material=nvisii.material.create("floor", base_color=(0.35, 0.33, 0.3), roughness=0.6),
)
add_body(floor, 0)
wall_mesh = nvisii.mesh.create_box("wall", (1.1, 0.1, 0.3))
for i in range(4):
    wall = nvisii.entity.create(
        name=f"wall_{i}",
        mesh=wall_mesh,
        transform=nvisii.transform.create(f"wall_{i}"),
        material=floor.get_material(),
    )
    turn = nvisii.angleAxis(i * nvisii.pi() / 2, (0, 0, 1))
    wall.get_transform().set_rotation(turn)
    wall.get_transform().set_position(turn * nvisii.vec3(0, 1.1, 0.3))
    add_body(wall, 0)

meshes = [
    nvisii.mesh.create_rounded_box("brick", 0.03, (0.15, 0.1, 0.07)),
    nvisii.mesh.create_icosphere("ball", 0.15),
    nvisii.mesh.create_capped_cylinder("can", 0.1, 0.14),
    nvisii.mesh.create_dodecahedron("die", 0.16),
]
bodies = {}
for i in range(opt.objects):
    name = f"object_{i}"
    entity = nvisii.entity.create(
        name=name,
        mesh=random.choice(meshes),
        transform=nvisii.transform.create(
            name,
            position=(random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7), 0.5 + 0.12 * i),
            rotation=nvisii.normalize(nvisii.quat(*np.random.RandomState(i).normal(size=4))),
        ),
        material=nvisii.material.create(
            name,
            base_color=[random.uniform(0.1, 0.9) for _ in range(3)],
            metallic=random.choice([0, 0, 1]),
            roughness=random.uniform(0.1, 0.7),
        ),
    )
    bodies[name] = add_body(entity, 0.2)

for _ in range(opt.steps):
    p.stepSimulation()

for name, body in bodies.items():
    position, rotation = p.getBasePositionAndOrientation(body)
    transform = nvisii.transform.get(name)
    transform.set_position(position)
    transform.set_rotation(nvisii.quat(rotation[3], rotation[0], rotation[1], rotation[2]))

nvisii.render_to_file(opt.size, opt.size, opt.spp, opt.out)
inside = sum(abs(nvisii.transform.get(name).get_position()[2]) < 2 for name in bodies)
print(f"{inside} of {len(bodies)} lie in or around the box")
p.disconnect(client)
nvisii.deinitialize()
