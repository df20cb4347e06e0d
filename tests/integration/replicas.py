"""A scene for worlds, and what each of them has for itself."""

import heliograph as hg
import numpy as np

PLANES = ["beauty", "beauty:lamps", "beauty:", "depth", "instance", "normal", "samples"]
CAMERAS = ["cam", "side"]
SPP, SEED, COUNT = 4, 11, 7
TEXTS = {"name", "attributes", "keypoint_name"}


def furnish(scene):
    """Three balls and a lamp under the studio, a camera "cam" and a second one "side"."""
    with scene.edit() as edit:
        edit.sample_studio()
        ball = hg.shapes.sphere(0.25)
        mesh = edit.mesh("mesh", **ball, keypoints={"top": (0, 0, 0.25)})
        edit.material("paint", base_color=(0.8, 0.2, 0.2))
        edit.instances("ball", mesh=mesh, material="paint", transforms=rows(), category="ball")
        light = hg.Light(power=50, shape="sphere", radius=0.1)
        edit.entity("lamp", light=light, transform=hg.Pose((0, 0, 2)), light_group="lamps")
        lens = hg.Camera.from_fov(50, 40, 24, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.3)))
        edit.entity("side", camera=lens, transform=hg.look_at((3, 0, 1), (0, 0, 0.3)))


def rows(shift=0.0):
    """(3, 4, 4): the balls side by side."""
    poses = np.tile(np.eye(4, dtype=np.float32), (3, 1, 1))
    poses[:, 0, 3] = np.array([-0.7, 0, 0.7]) + shift
    poses[:, 2, 3] = 0.25
    return poses


BALLS = ["ball/0", "ball/1", "ball/2"]
MATRICES = np.stack([rows(0.05 * i) for i in range(COUNT)])


def of_world(edit, i):
    """Differences of world i from the scene, besides its poses."""
    if i == 1:
        edit.material("paint", base_color=(0.1, 0.9, 0.1), roughness=0.1)
    if i == 2:
        edit.update(
            "lamp",
            light=hg.Light(power=200, shape="sphere", radius=0.1),
            transform=hg.Pose((1, 0, 1.5)),
        )
    if i == 3:
        edit.dome(color=(0, 0, 1), intensity=2)
    if i == 4:
        edit.update(
            "cam",
            camera=hg.Camera.from_fov(80, 40, 24, degrees=True),
            transform=hg.look_at((0, -2, 2), (0, 0, 0)),
        )
    if i == 5:
        edit.remove("ball/1")
        edit.material("net", alpha=0.6, alpha_mode="blend")  # the one with holes
        edit.entity("more", mesh="mesh", material="net", transform=hg.Pose((0, 0, 1)))


def the_worlds(scene):
    worlds = hg.Worlds(COUNT).set_transforms(BALLS, MATRICES)
    for i in range(1, 6):
        with scene.overlay() as overlay:
            of_world(overlay, i)
        worlds[i] = overlay
    return worlds


def alone(scene, i, **options):
    """World i as a request of its own."""
    with scene.overlay() as overlay:
        overlay.set_transforms(BALLS, MATRICES[i])
        of_world(overlay, i)
    return scene.render(CAMERAS, overlay=overlay, seed=seed_of(SEED, i), **options)


def seed_of(seed, i):
    """As in render.proto."""
    x, mask = i, 2**64 - 1
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & mask
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & mask
    return seed ^ x ^ (x >> 31)
