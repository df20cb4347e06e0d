"""The writers of everything: EXR, WebDataset shards and Parquet tables."""

import io
import json
import tarfile

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import OpenEXR
import pyarrow.parquet
import pytest
from heliograph.datasets.writers import exr, webdataset

COUNT = 5


def furnished(scene):
    with scene.edit() as edit:
        edit.dome(color=1)
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2), keypoints={"top": (0, 0, 0.2)})
        edit.entity("ball", mesh=mesh, category="ball", attributes={"grade": "A", "lot": "7"})
        edit.entity("behind", mesh=mesh, transform=hg.Pose((0, -3, 0)))
        lens = hg.Camera.from_fov(50, 40, 30, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -2, 1), (0, 0, 0.2)))


def scatter(draw):
    draw.place("ball", [hg.Pose((*draw.rng.uniform(-0.5, 0.5, 2), 0.2))])


@pytest.fixture(scope="module")
def stage(client):
    with client.create_scene() as scene:
        furnished(scene)
        yield scene


def keeping(kind, frames):
    class Kept(kind):
        def write(self, image):
            frames[image.index] = image.frame
            return super().write(image)

    return Kept


def make(scene, writer, **options):
    return hd.generate(
        scene, "cam", scatter, writer=writer, **{"count": COUNT, "spp": 2, **options}
    )


def agrees(row, frame, k):
    """Are all label columns of instance k in a row?"""
    for name in frame.labels:
        value = frame.labels[name]
        if name.startswith("keypoint_") or name == "category":
            continue
        if name == "attributes":
            pairs = row[name]
            if isinstance(pairs, list):
                pairs = {pair["key"]: pair["value"] for pair in pairs}
            assert pairs == json.loads(value[k])
        elif isinstance(value, list):
            assert row[name] == value[k]
        else:
            got = np.array(row[name], dtype=float).reshape(value[k].shape)  # None is nan
            finite = np.isfinite(value[k])
            np.testing.assert_array_equal(got[finite], value[k][finite].astype(float))
            assert np.isnan(got[~finite]).all()
    assert row["category"] == frame.categories.get(frame.labels["category"][k], "")


def test_exr_has_every_plane_as_it_is(stage, tmp_path):
    frames = {}
    make(stage, keeping(hd.Exr, frames)(tmp_path), count=2, splits={"train": 0.5, "val": 0.5})
    names = {path.name: path for path in tmp_path.glob("exr/*/*.exr")}
    assert sorted(names) == ["000000.exr", "000001.exr"]
    frame = frames[0]
    parts = {part.name(): part for part in OpenEXR.File(str(names["000000.exr"])).parts}
    assert set(parts) == set(frame) and len(parts) > 25
    depth = parts["depth"].channels["depth"].pixels
    np.testing.assert_array_equal(depth, frame["depth"])
    np.testing.assert_array_equal(parts["instance"].channels["instance"].pixels, frame["instance"])
    split = names["000000.exr"].parent.name
    labels = json.loads((tmp_path / "labels" / split / "000000.json").read_text())
    assert labels["split"] == split
    np.testing.assert_array_equal(labels["K"], frame.K)
    for k, row in enumerate(labels["instances"]):
        agrees(row, frame, k)
    assert labels["instances"][1]["corners_image"][0] == [None, None]  # behind the camera
    assert labels["keypoints"][0]["name"] == "top"


def test_shards_are_plain_tars_of_samples(stage, tmp_path):
    frames = {}
    writer = keeping(hd.WebDataset, frames)(tmp_path, planes=["depth", "instance"], shard_size=2)
    make(stage, writer)
    shards = sorted(path.name for path in tmp_path.glob("*"))
    assert shards == [".heliograph", "000000.tar", "000001.tar", "000002.tar"]
    assert not list((tmp_path / ".heliograph/parts").iterdir())
    found = {}
    for shard in shards[1:]:
        with tarfile.open(tmp_path / shard) as tar:
            for info in tar:
                assert (info.mtime, info.uid, info.gid, info.uname) == (0, 0, 0, "")
                found[info.name] = tar.extractfile(info).read()
    ends = ["png", "json", "depth.npy", "instance.npy"]
    assert list(found) == [f"{i:06d}.{end}" for i in range(COUNT) for end in ends]
    for index, frame in frames.items():
        for plane in ("depth", "instance"):
            array = np.load(io.BytesIO(found[f"{index:06d}.{plane}.npy"]))
            np.testing.assert_array_equal(array, frame[plane])
        labels = json.loads(found[f"{index:06d}.json"])
        agrees(labels["instances"][0], frame, 0)
        assert found[f"{index:06d}.png"] == hd.Picture().encode(frame)


def test_shards_grow_and_are_the_same_bytes(client, stage, tmp_path):
    def shards(name):
        return {path.name: path.read_bytes() for path in sorted((tmp_path / name).glob("*.tar"))}

    splits = {"train": 0.7, "val": 0.3}
    make(stage, hd.WebDataset(tmp_path / "grown", shard_size=3), count=4, splits=splits)
    make(stage, hd.WebDataset(tmp_path / "grown", shard_size=3), count=12, splits=splits)
    with client.create_scene() as other:  # another scene of the daemon
        furnished(other)
        writer = hd.WebDataset(tmp_path / "whole", shard_size=3)
        make(other, writer, count=12, splits=splits)
        again = make(other, writer, count=12, splits=splits)
        assert again.images == 0
    assert len(shards("whole")) == 5
    assert shards("whole") == shards("grown")
    (tmp_path / "whole/train-000001.tar").unlink()
    with pytest.raises(hg.FailedPrecondition, match=r"train-000001.tar lacks images"):
        make(stage, hd.WebDataset(tmp_path / "whole", shard_size=3), count=12, splits=splits)


@pytest.mark.parametrize("longer", [False, True])
def test_a_sample_made_again_takes_its_place_in_the_shard(stage, tmp_path, monkeypatch, longer):
    def samples():
        with tarfile.open(shard) as tar:
            return {info.name: tar.extractfile(info).read() for info in tar}

    shard = tmp_path / "000000.tar"
    make(stage, hd.WebDataset(tmp_path))
    before, whole = samples(), shard.read_bytes()
    (tmp_path / ".heliograph/records/000001.json").unlink()
    if longer:  # as of another version
        more = {"more": "x" * 9999}
        monkeypatch.setattr(webdataset, "labels_of", lambda *of: {**exr.labels_of(*of), **more})
    again = make(stage, hd.WebDataset(tmp_path))
    assert (again.images, again.complete) == (1, True)
    assert not list((tmp_path / ".heliograph/parts").iterdir())
    after = samples()
    assert list(after) == list(before)
    changed = [name for name in before if after[name] != before[name]]
    assert changed == (["000001.json"] if longer else [])
    assert longer or shard.read_bytes() == whole
    monkeypatch.undo()
    assert make(stage, hd.WebDataset(tmp_path), count=COUNT + 1).images == 1
    assert list(samples().items())[: len(after)] == list(after.items())


def test_a_shard_that_is_cut_off_is_told(stage, tmp_path):
    make(stage, hd.WebDataset(tmp_path))
    shard = tmp_path / "000000.tar"
    shard.write_bytes(shard.read_bytes()[:-2000])
    with pytest.raises(hg.FailedPrecondition, match=r"000000.tar lacks images.*resume=False"):
        make(stage, hd.WebDataset(tmp_path), count=COUNT + 1)


def test_tables_have_every_label(stage, tmp_path):
    frames = {}
    make(stage, keeping(hd.Parquet, frames)(tmp_path))
    tables = {
        name: pyarrow.parquet.read_table(tmp_path / f"{name}.parquet")
        for name in ("images", "instances", "keypoints")
    }
    images = tables["images"].to_pylist()
    assert [row["index"] for row in images] == list(range(COUNT))
    instances = tables["instances"].to_pylist()
    assert len(instances) == 2 * COUNT
    for i, row in enumerate(instances):
        assert row["index"] == i // 2
        agrees(row, frames[i // 2], i % 2)
    for row in images:
        np.testing.assert_array_equal(np.reshape(row["K"], (3, 3)), frames[row["index"]].K)
        assert (row["file"], row["samples"]) == ("", 0)
    for row in tables["keypoints"].to_pylist():
        labels = frames[row["index"]].labels
        k = int(np.flatnonzero(labels["keypoint_instance"] == row["label"])[0])
        assert row["state"] == labels["keypoint_state"][k]
    assert str(tables["instances"].schema.field("bbox_visible").type) == (
        "fixed_size_list<element: int32>[4]"
    )
    assert not (tmp_path / "images").exists()


def test_tables_without_rows_have_their_types(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.entity("cam", camera=hg.Camera.from_fov(1, 16, 16))
        writer = hd.Parquet(tmp_path, labels=["boxes"], picture="jpg")
        hd.generate(scene, "cam", lambda draw: None, count=2, spp=1, writer=writer)
    instances = pyarrow.parquet.read_table(tmp_path / "instances.parquet")
    assert instances.num_rows == 0
    assert "bbox_visible" in instances.column_names
    images = pyarrow.parquet.read_table(tmp_path / "images.parquet").to_pylist()
    assert [row["file"] for row in images] == ["images/000000.jpg", "images/000001.jpg"]
    assert not (tmp_path / "keypoints.parquet").exists()
