"""Refusals of writers of data sets, without a daemon."""

import sys
from types import SimpleNamespace

import hand_made
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph.datasets.writers import kitti, ndds
from heliograph.datasets.writers.instances import instances

W, H = hand_made.SIZE


def test_poses_that_are_no_rotations_are_refused_by_name():
    rows = hand_made.rows({"rigid": np.uint8(0)})
    (sheared,) = instances(hand_made.frame({}, rows, categories={1: "thing"}), None)
    for made in (kitti.label_line, lambda thing: ndds.object_data(thing, hand_made.K)):
        with pytest.raises(hg.InvalidArgument, match="thing/0: .*shear"):
            made(sheared)


@pytest.mark.parametrize("writer", [hd.Bop, hd.Kitti, hd.Ndds])
def test_scenes_without_categories_are_refused(writer, tmp_path):
    dataset = hd.Dataset(SimpleNamespace(), ["cam"], 1, 0)
    with pytest.raises(hg.InvalidArgument, match="category="):
        writer(tmp_path).begin(dataset)
    named = hd.Dataset(SimpleNamespace(), ["cam"], 1, 0, categories={1: "car"})
    with pytest.raises(hg.NotFound, match="bike.*there are car"):
        writer(tmp_path, categories=["bike"]).begin(named)


@pytest.mark.parametrize("lens", [{"distortion": (0.1, 0, 0, 0)}, {"projection": "fisheye"}])
def test_lenses_that_k_cannot_say_are_refused(lens, tmp_path):
    camera = hg.Camera.from_intrinsics(hand_made.K, W, H, **lens)
    scene = SimpleNamespace(handle=lambda id: SimpleNamespace(camera=camera))
    writer = hd.Ndds(tmp_path, resolve_symmetries=False)
    cameras = [SimpleNamespace(id=7, name="cam")]
    writer.begin(hd.Dataset(scene, cameras, 1, 0, categories={1: "car"}))
    with pytest.raises(hg.InvalidArgument, match="cam: .*pinholes"):
        writer.write(hd.Image(0, hand_made.frame()))


def test_settings_that_are_none(tmp_path):
    with pytest.raises(hg.InvalidArgument, match="visibility"):
        hd.Bop(tmp_path, visibility="about")
    with pytest.raises(hg.InvalidArgument, match="depth_scale"):
        hd.Bop(tmp_path, depth_scale=0)
    with pytest.raises(hg.InvalidArgument, match="objects"):
        hd.Kitti(tmp_path, objects=False)
    with pytest.raises(hg.InvalidArgument, match="PNG"):
        hd.Middlebury(tmp_path, picture="jpg")
    with pytest.raises(hg.InvalidArgument, match="times"):
        hd.TapVid(tmp_path, times=[])


@pytest.mark.parametrize(
    ("package", "use"),
    [
        ("pyarrow", lambda root: hd.Parquet(root)),
        ("OpenEXR", lambda root: hand_made.frame().save(root / "a.exr")),
        ("OpenEXR", lambda root: hd.validate(root, "exr")),
    ],
)
def test_packages_that_are_missing_are_named(package, use, tmp_path, monkeypatch):
    for folder, ending in (("exr", "exr"), ("labels", "json")):
        (tmp_path / folder).mkdir()
        (tmp_path / f"{folder}/000000.{ending}").write_text(
            '{"width": 1, "height": 1, "K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "instances": [], '
            '"camera_from_world_cv": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}'
        )
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(hg.Unimplemented, match=f"need the package {package}: pip install"):
        use(tmp_path)
