"""The validator on frames of lenses with distortion and of rolling shutters: clean ones pass with
every check made, each planted fault is named, and what cannot be checked is said."""

import json
import shutil

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import OpenEXR
import pytest
from heliograph.datasets.validation.exr import read_planes
from heliograph.datasets.writers.exr import PLANES

SIZE = (64, 48)
MOTION = "flow_forward flow_forward_valid flow_forward_visible scene_flow".split()
LENSES = {
    "pinhole": hg.Camera(*SIZE, 80.0, 78.0, 30.5, 25.5),
    "distorted": hg.Camera(*SIZE, 80.0, 78.0, 30.5, 25.5, distortion=(-0.3, 0.08, 0.004, 0.002)),
    "rational": hg.Camera(
        *SIZE, 80.0, 80.0, 31.5, 23.5, distortion=(0.2, 0.1, 0, 0, 0.02, 0.3, 0.05, 0.01)
    ),
    "fisheye": hg.Camera(*SIZE, 30, 31.0, 31.5, 23.5, "fisheye", distortion=(-0.05, 0.01, 0, 0)),
    "panorama": hg.Camera.equirectangular(*SIZE),
    "orthographic": hg.Camera(*SIZE, 40.0, 41.0, 30.3, 25.1, "orthographic"),
}


def with_points(edit):
    points = {"tip": (0, 0, 0.15)}
    mesh = edit.mesh("mesh", **hg.shapes.cylinder(0.07, 0.3), keypoints=points)
    for i in range(5):
        turn = (0.4 * i, 0.3 * i, 0.1)
        first = hg.Pose((0.3 * i - 0.6, 0.15 * i - 0.3, 0.3), euler=turn)
        later = hg.Pose((0.3 * i - 0.58, 0.15 * i - 0.3, 0.32), euler=(*turn[:2], 0.2))
        edit.entity(f"bolt/{i}", mesh=mesh, category="bolt", keys={0: first, 0.1: later})


def furnish(edit, lens):
    edit.sample_studio()
    with_points(edit)
    keys = [hg.look_at(eye, (0, 0, 0.2)) for eye in ((0, -1.6, 1), (0.06, -1.55, 1.03))]
    edit.entity("cam", camera=lens, keys={0: keys[0], 0.1: keys[1]})


def made(client, root, lens, **options):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            furnish(edit, lens)
        writer = hd.Exr(root, planes=[*PLANES, *MOTION])
        hd.generate(scene, "cam", lambda draw: None, count=1, spp=1, writer=writer, **options)
    return root


@pytest.fixture(scope="module")
def sets(client, tmp_path_factory):
    """The directory of a lens, or of "rolling"."""
    there = {}

    def get(name):
        if name not in there:
            root = tmp_path_factory.mktemp("lenses") / name
            options = {"time": 0.05, "frame_interval": 0.05, "hold": True}
            lens = LENSES.get(name)
            if lens is None:
                lens = hg.Camera(*SIZE, 80.0, 78.0, 30.5, 25.5, rolling=0.06)
            there[name] = made(client, root, lens, **options)
        return there[name]

    return get


@pytest.mark.parametrize("name", LENSES)
def test_every_lens_is_checked_whole(name, sets):
    report = hd.validate(sets(name), "exr")
    assert report.ok and report.left_out == [], str(report)


def test_a_rolling_shutter_is_checked_but_for_its_other_ends(sets):
    report = hd.validate(sets("rolling"), "exr")
    assert report.ok, str(report)
    assert {each.check for each in report.left_out} <= {
        "exr.flow",
        "exr.object_points",
        "exr.normals",  # of rows on the floor alone
    }
    assert all("rolling shutter" in each.reason for each in report.left_out)


# ------------------------------------------------------------ faults


def save(path, planes):
    parts = []
    for name, data in planes.items():
        if data.ndim == 2:
            channels = {name.partition(":")[0]: np.ascontiguousarray(data)}
        else:
            names = "RGBA" if name == "beauty" else "XYZW"
            channels = {names[i]: np.ascontiguousarray(data[..., i]) for i in range(data.shape[2])}
        parts.append(OpenEXR.Part({"type": OpenEXR.scanlineimage}, channels, name))
    OpenEXR.File(parts).write(str(path))


def on_thing(planes, row=None):
    """Row and column of a pixel of an instance, of that row."""
    seen = planes["instance"] > 0
    if row is not None:
        seen[np.arange(len(seen)) != row] = False
    y, x = np.argwhere(seen)[seen.sum() // 2]
    return int(y), int(x)


def moved(name, by, row=None):
    def plant(planes, content):
        planes[name][on_thing(planes, row)] += np.asarray(by, "f4")

    return plant


def coefficient(planes, content):
    content["distortion"][0] *= -1


def focal(planes, content):
    content["K"][0][0] *= 1.01


def beside(planes, content):
    """A point a third of a pixel beside its centre, in every plane that tells it."""
    y, x = on_thing(planes)
    here, next_ = planes["position_camera"][y, x], planes["position_camera"][y, x + 1]
    planes["position_camera"][y, x] = here + (next_ - here) / 3
    planes["depth"][y, x] = planes["position_camera"][y, x, 2]
    planes["distance"][y, x] = np.linalg.norm(planes["position_camera"][y, x])
    for name in ("position", "object_coordinates", "nocs", "flow_forward"):
        planes.pop(name)


def corner(planes, content):
    content["instances"][0]["corners_image"][0][0] += 3


def tip(planes, content):
    point = next(p for p in content["keypoints"] if p["image"][0] is not None)
    point["image"][0] += 1.5
    point["state"] = 0


def turned(name, row=None):
    def plant(planes, content):
        y, x = on_thing(planes, row)
        planes[name][y, x] = planes[name][y, x][[1, 2, 0]]

    return plant


def other_pose(planes, content):
    """The pose of the first row, in the rows of labels, too."""
    by = np.eye(4)
    by[0, 3] = 0.05
    pose = by @ np.array(content["camera_from_world_cv"])
    content["camera_from_world_cv"] = pose.tolist()
    for row in content["instances"]:
        row["camera_from_object_cv"] = (pose @ np.array(row["world_from_object"])).tolist()
        row.pop("corners_camera")
    content["keypoints"] = []


LENS_FAULTS = {
    "another coefficient": ("camera", coefficient),
    "another focal length": ("camera", focal),
    "a point beside its pixel": ("projection", beside),
    "flow of a pinhole": ("flow", moved("flow_forward", (0.4, 0))),
    "corner off": ("corners", corner),
    "keypoint off": ("keypoints", tip),
}
ROLLING_FAULTS = {
    "a position off": ("positions", moved("position", (0.01, 0, 0))),
    "a point beside its pixel": ("projection", beside),
    "pose of another time": ("camera", other_pose),
    "a normal not turned": ("normals", turned("normal_camera", SIZE[1] // 2)),
    "focal length": ("camera", focal),
}


def faults_with(root, tmp_path, plant):
    """The names of the checks that find it."""
    copy = tmp_path / "copy"
    shutil.copytree(root, copy)
    planes = {k: v.copy() for k, v in read_planes(copy / "exr/000000.exr").items()}
    content = json.loads((copy / "labels/000000.json").read_text())
    plant(planes, content)
    save(copy / "exr/000000.exr", planes)
    (copy / "labels/000000.json").write_text(json.dumps(content))
    return hd.validate(copy, "exr")


@pytest.mark.parametrize("lens", ["distorted", "rational", "fisheye"])
@pytest.mark.parametrize("fault", LENS_FAULTS)
def test_faults_of_a_lens_are_named(lens, fault, sets, tmp_path):
    check, plant = LENS_FAULTS[fault]
    report = faults_with(sets(lens), tmp_path, plant)
    assert set(report.counts) == {f"exr.{check}"}, str(report)


@pytest.mark.parametrize("fault", ROLLING_FAULTS)
def test_faults_of_a_rolling_shutter_are_named(fault, sets, tmp_path):
    check, plant = ROLLING_FAULTS[fault]
    report = faults_with(sets("rolling"), tmp_path, plant)
    assert set(report.counts) == {f"exr.{check}"}, str(report)


def test_a_lens_that_no_file_names_is_told(sets, tmp_path):
    def nameless(planes, content):
        del content["projection"], content["distortion"]

    report = faults_with(sets("distorted"), tmp_path, nameless)
    assert report.ok, str(report)
    left = {each.check for each in report.left_out}
    assert left == {"exr.projection", "exr.flow", "exr.corners", "exr.keypoints"}
    assert "the file has no projection and distortion" in str(report)


# ------------------------------------------------------------ other files


def test_saved_frames_alone(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            furnish(edit, LENSES["pinhole"])
            edit.entity(
                "bent", camera=LENSES["distorted"], transform=hg.look_at((0, -2, 1), (0, 0, 0))
            )
        planes = ["beauty", "depth", "position", "position_camera", "normal", "instance", "nocs"]
        planes.append("object_coordinates")
        for name in ("cam", "bent"):
            frame = scene.render(name, spp=1, planes=planes, labels=True, time=0.05)
            for ending in ("exr", "npz"):
                frame.save(tmp_path / f"{name}.{ending}")
    report = hd.validate(tmp_path)
    assert (report.ok, report.formats) == (True, ["frame"]), str(report)
    left = {each.check: each.pieces for each in report.left_out}
    assert left["frame.poses"] == 2 and left["frame.projection"] == 2  # of EXR; of the bent lens
    arrays = dict(np.load(tmp_path / "cam.npz"))
    arrays["position_camera"][on_thing(arrays)] *= 1.02
    np.savez(tmp_path / "bad.npz", **arrays)
    report = hd.validate(tmp_path / "bad.npz")
    assert set(report.counts) == {"frame.depth", "frame.positions"}, str(report)


def test_lenses_of_cameras_without_names(client, tmp_path):
    bent = LENSES["distorted"]
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            with_points(edit)
            view = hg.look_at((0, -1.6, 1), (0, 0, 0.2))
            cameras = [
                edit.entity(camera=lens, transform=view) for lens in (LENSES["pinhole"], bent)
            ]
        writers = [hd.WebDataset(tmp_path / "tar"), hd.Parquet(tmp_path / "tables")]
        writers += [hd.Exr(tmp_path / "exr"), hd.Colmap(tmp_path / "colmap", points=200)]
        writers.append(hd.TapVid(tmp_path / "tapvid", times=[0, 0.1], points=20))
        hd.generate(scene, cameras, lambda draw: None, count=2, spp=1, writer=writers)
    for name in ("tar", "tables", "exr", "colmap", "tapvid"):
        report = hd.validate(tmp_path / name)
        assert report.ok and report.left_out == [], str(report)
    arrays = [np.load(tmp_path / f"tapvid/00000{i}.npz")["video"] for i in range(2)]
    assert (arrays[0] != arrays[1]).any()
    labels = [json.loads((tmp_path / f"exr/labels/00000{i}.json").read_text()) for i in range(2)]
    assert labels[0]["distortion"] == [] and labels[1]["distortion"] == list(bent.distortion)
