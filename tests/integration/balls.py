"""A scene of three balls, and data sets of it. Used by the tests of generate()."""

import heliograph as hg
import heliograph.datasets as hd
import pytest

BALLS, SIZE = 3, (80, 60)


def furnished(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
        edit.categories("cube", "ball")
        poses = [hg.Pose((0.4 * i - 0.4, 0, 0.2)) for i in range(BALLS)]
        balls = edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
        lens = hg.Camera.from_fov(50, *SIZE, degrees=True)
        cam = edit.entity("cam", camera=lens, transform=hg.look_at((0, -2, 1), (0, 0, 0.2)))
        edit.entity("side", camera=lens, transform=hg.look_at((2, 0, 1), (0, 0, 0.2)))
    return balls, cam


@pytest.fixture(scope="module")
def stage(client):
    """(scene, balls, camera)"""
    with client.create_scene() as scene:
        yield scene, *furnished(scene)


def scatter(balls):
    def randomize(draw):
        poses = [hg.Pose((*draw.rng.uniform(-0.6, 0.6, 2), 0.2)) for _ in balls]
        draw.place(balls, poses)

    return randomize


def spin(draw):
    draw.edit.dome(rotation=draw.rng.uniform(0, 6))


def make(stage, out, count=3, **options):
    scene, balls, cam = stage
    rand = hd.Compose(scatter(balls), spin)
    writer = options.pop("writer", None) or hd.Coco(out)
    cameras = options.pop("cameras", cam)
    return hd.generate(scene, cameras, rand, count=count, writer=writer, **{"spp": 2, **options})


def files(root, but=()):
    """Name to bytes of all that a data set has."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in but
    }
