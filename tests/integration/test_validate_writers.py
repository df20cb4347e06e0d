"""Files of the writers have no faults by the validator, which shares no code with them."""

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from PIL import Image

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


def written(stage, writer, randomizer=None, **options):
    """The report of a data set of four images."""
    scene, things, cam = stage
    options = {"count": 4, "spp": 1, "progress": False, **options}
    hd.generate(scene, cam, randomizer or jumble(things), writer=writer, **options)
    return hd.validate(writer.directory)


def test_coco(stage, tmp_path):
    report = written(stage, hd.Coco(tmp_path / "out"))
    assert report.ok, str(report)
    assert report.formats == ["coco", "dataset"]
    everything = hd.Coco(tmp_path / "split", keypoints=True, panoptic=True, stuff=["ball"])
    report = written(stage, everything, splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)


def test_bop(stage, tmp_path):
    report = written(stage, hd.Bop(tmp_path / "exact"))
    assert report.ok, str(report)
    delta = hd.Bop(tmp_path / "delta", visibility="bop-delta", depth_scale=0.1)
    report = written(stage, delta, splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
    assert report.formats == ["bop", "dataset"]


def test_kitti(stage, tmp_path):
    writer = hd.Kitti(tmp_path / "out", flow=True)
    report = written(stage, writer, frame_interval=0.1, hold=True)
    assert report.ok, str(report)
    assert report.formats == ["kitti", "dataset"]


def test_middlebury(stage, tmp_path):
    report = written(stage, hd.Middlebury(tmp_path / "out"), frame_interval=0.1, hold=True)
    assert report.ok, str(report)
    assert report.formats == ["flo", "dataset"]


def test_ndds(stage, tmp_path):
    report = written(stage, hd.Ndds(tmp_path / "out"))
    assert report.ok, str(report)
    report = written(stage, hd.Ndds(tmp_path / "split"), splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
    assert report.formats == ["ndds", "dataset"]


@pytest.mark.parametrize("task", ["box", "seg", "pose"])
def test_yolo(stage, tmp_path, task):
    report = written(stage, hd.Yolo(tmp_path / "out", task=task), splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
    assert report.formats == ["yolo", "dataset"]


def test_tapvid(stage, tmp_path):
    report = written(stage, hd.TapVid(tmp_path / "out", times=[0, 0.1, 0.2], points=16))
    assert report.ok, str(report)
    assert report.formats == ["tapvid", "dataset"]


def walk(draw):
    """Moves the camera alone."""
    eye = draw.rng.uniform((-1, -1.8, 0.8), (1, -1.2, 1.4))
    draw.place([draw.camera], [hg.look_at(tuple(eye), (0, 0, 0.2))])


def test_nerf(stage, tmp_path):
    report = written(stage, hd.NerfTransforms(tmp_path / "out"), randomizer=walk)
    assert report.ok, str(report)
    assert report.formats == ["nerf", "dataset"]


def test_colmap(stage, tmp_path):
    report = written(stage, hd.Colmap(tmp_path / "out", points=300), randomizer=walk)
    assert report.ok, str(report)
    assert report.formats == ["colmap", "dataset"]


MOTION = "flow_forward flow_forward_valid flow_forward_visible scene_flow".split()


def keyed(stage):
    """Things and the camera move and turn between 0 and 0.1 s."""
    _, things, cam = stage

    def randomize(draw):
        for i, thing in enumerate(things):
            place = draw.rng.uniform((-0.5, -0.3, 0.1), (0.5, 0.3, 0.4))
            turn = draw.rng.uniform(-3, 3, 3)
            later = hg.Pose(tuple(place + (0.05, 0.02 * i, 0)), euler=tuple(turn + 0.2))
            draw.edit.update(thing, keys={0: hg.Pose(tuple(place), euler=tuple(turn)), 0.1: later})
        eyes = [(0, -1.6, 1), (0.05, -1.55, 1.02)]
        keys = [hg.look_at(eye, (0.02, 0, 0.2)) for eye in eyes]
        draw.edit.update(cam, keys={0: keys[0], 0.1: keys[1]})

    return randomize


def test_exr(stage, tmp_path):
    from heliograph.datasets.writers.exr import PLANES

    writer = hd.Exr(tmp_path / "out", planes=[*PLANES, *MOTION])
    report = written(stage, writer, keyed(stage), frame_interval=0.1, hold=True)
    assert report.ok, str(report)
    assert report.formats == ["exr", "dataset"]


LENSES = {
    "orthographic": hg.Camera(*SIZE, 40.0, 41.0, 30.3, 25.1, "orthographic"),
    "fisheye": hg.Camera(*SIZE, 40.0, 40.0, 35.5, 23.5, "fisheye"),
    "distorted": hg.Camera(*SIZE, 80.0, 80.0, 35.5, 23.5, distortion=(-0.2, 0.05, 0.001, 0.002, 0)),
}


@pytest.mark.parametrize("name", LENSES)
def test_exr_of_other_lenses(stage, tmp_path, name):
    from heliograph.datasets.writers.exr import PLANES

    scene, things, cam = stage

    def randomize(draw):
        jumble(things)(draw)
        draw.edit.update(cam, camera=LENSES[name])

    report = written(stage, hd.Exr(tmp_path / "out", planes=PLANES), randomize, count=2)
    assert report.ok, str(report)


def test_exr_of_a_rolling_shutter(stage, tmp_path):
    from heliograph.datasets.writers.exr import PLANES

    _, _, cam = stage

    def randomize(draw):
        keyed(stage)(draw)
        lens = hg.Camera.from_fov(45, *SIZE, degrees=True, rolling=0.04)
        draw.edit.update(cam, camera=lens)

    writer = hd.Exr(tmp_path / "out", planes=[*PLANES, *MOTION])
    options = {"count": 1, "time": 0.02, "frame_interval": 0.05, "hold": True}
    report = written(stage, writer, randomize, **options)
    assert report.ok, str(report)


def test_webdataset(stage, tmp_path):
    planes = ["depth", "instance", "position", "position_camera"]
    writer = hd.WebDataset(tmp_path / "out", planes=planes, shard_size=2)
    report = written(stage, writer, count=5)
    assert report.ok, str(report)
    report = written(stage, hd.WebDataset(tmp_path / "split"), splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
    assert report.formats == ["webdataset", "dataset"]


def test_parquet(stage, tmp_path):
    report = written(stage, hd.Parquet(tmp_path / "out", picture="png"))
    assert report.ok, str(report)
    report = written(stage, hd.Parquet(tmp_path / "split"), splits={"train": 0.5, "val": 0.5})
    assert report.ok, str(report)
    assert report.formats == ["parquet", "dataset"]


def test_a_name_with_delta_excuses_nothing(stage, tmp_path):
    root = tmp_path / "delta_robot"
    written(stage, hd.Bop(root))
    first, second = sorted(root.glob("*/000000/mask_visib/000000_*.png"))[:2]
    both = np.array(Image.open(first)) | np.array(Image.open(second))
    for path in (first, second):
        Image.fromarray(both).save(path)
    assert "bop.mask_disjoint" in hd.validate(root).counts


def test_a_wall_beside_the_camera_has_its_centre_behind_it(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            wall = edit.mesh("cube", **hg.shapes.cube())
            place = np.diag([16, 0.3, 2, 1.0])
            place[:3, 3] = (-0.5, 2, 0)
            edit.entity("wall", mesh=wall, category="wall", transform=place)
            lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, 0, 0), (1, 0, 0)))
        hd.generate(scene, "cam", lambda draw: None, count=1, spp=1, writer=hd.Bop(tmp_path))
    report = hd.validate(tmp_path)
    assert report.ok, str(report)


def test_a_writer_gives_back_its_scenes(client, stage, tmp_path):
    before = len(client.scenes())
    for indices in ([0], [1]):
        writer = hd.Bop(tmp_path, visibility="bop-delta")
        scene, things, cam = stage
        options = {"count": 4, "spp": 1, "indices": indices, "writer": writer}
        hd.generate(scene, cam, jumble(things), **options)
    assert len(client.scenes()) == before
