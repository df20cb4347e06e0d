"""What the writers write has no faults by the validator, which shares no code with them."""

import heliograph as hg
import heliograph.datasets as hd
import pytest

SIZE = (72, 48)


@pytest.fixture(scope="module")
def stage(client):
    """(scene, things, camera): things that hide each other and cross the image's edges."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            points = {"tip": (0, 0, 0.15), "foot": (0, 0, -0.15)}
            edit.categories("bolt", "ball")
            bolt = edit.mesh("bolt_mesh", **hg.shapes.cylinder(0.07, 0.3), keypoints=points)
            ball = edit.mesh("ball_mesh", **hg.shapes.sphere(0.15))
            poses = [hg.Pose((0.25 * i - 0.6, 0.1 * (i % 3), 0.2)) for i in range(3)]
            things = edit.instances("bolt", mesh=bolt, transforms=poses, category="bolt")
            poses = [hg.Pose((0.25 * i, 0.05 * i, 0.2)) for i in range(3)]
            balls = edit.instances("ball", mesh=ball, transforms=poses, category="ball")
            things = [*things, *balls]
            lens = hg.Camera.from_fov(45, *SIZE, degrees=True)
            cam = edit.entity("cam", camera=lens, transform=hg.look_at((0, -1.6, 1), (0, 0, 0.2)))
        yield scene, things, cam


def jumble(things):
    def randomize(draw):
        poses = []
        for _ in things:
            place = draw.rng.uniform((-0.8, -0.4, 0.1), (0.8, 0.4, 0.5))
            euler = draw.rng.uniform(-3, 3, 3)
            poses.append(hg.Pose(tuple(place), euler=tuple(euler)))
        draw.place(things, poses)

    return randomize


def written(stage, writer, count=4, **options):
    scene, things, cam = stage
    hd.generate(
        scene, cam, jumble(things), count=count, writer=writer, spp=1, progress=False, **options
    )
    return hd.validate(writer.directory)


def test_coco(stage, tmp_path):
    report = written(stage, hd.Coco(tmp_path / "out"))
    assert report.ok, str(report)
    assert report.formats == ["coco", "dataset"]
    everything = hd.Coco(tmp_path / "split", keypoints=True, panoptic=True, stuff=["ball"])
    report = written(stage, everything, splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
