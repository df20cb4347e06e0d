"""The same seed gives the same files: in another daemon, in shards, of every writer of poses."""

import heliograph as hg
import heliograph.datasets as hd
import pytest
from dataset_stage import LENS, H, W, shift, stage, view

DT = {"frame_interval": 0.5, "time": 0.0, "hold": True}
MAKERS = {
    "bop": (lambda root: hd.Bop(root, visibility="bop-delta"), shift, {}),
    "kitti": (lambda root: hd.Kitti(root, flow=True), shift, DT),
    "ndds": (hd.Ndds, shift, {}),
    "middlebury": (hd.Middlebury, shift, DT),
    "tapvid": (lambda root: hd.TapVid(root, times=[0, 0.5], points=20), shift, {}),
    "nerf": (hd.NerfTransforms, view, {}),
    "colmap": (lambda root: hd.Colmap(root, points=500), view, {}),
}


def files(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and ".heliograph" not in path.parts
    }


@pytest.fixture(scope="module")
def scenes():
    """The same scene in two daemons."""
    with hg.connect() as one, hg.connect() as two:
        with one.create_scene() as first, two.create_scene() as second:
            for scene in (first, second):
                stage(scene)
                with scene.edit() as edit:
                    edit.entity("other", camera=LENS, transform=hg.look_at((1, -2, 1), (0, 0, 0)))
            yield first, second


@pytest.mark.parametrize("name", MAKERS)
def test_shards_of_another_daemon_are_the_same_files(name, scenes, tmp_path):
    make, randomizer, options = MAKERS[name]
    options = {
        "count": 6,
        "spp": 1,
        "seed": 5,
        "size": (W, H),
        "splits": {"train": 0.5, "val": 0.5},
    } | options
    whole, shards = tmp_path / "a" / "set", tmp_path / "b" / "set"
    cameras = ["cam", "other"]
    done = hd.generate(scenes[0], cameras, randomizer, writer=make(whole), **options)
    assert done.complete
    for indices in ([4, 1], [5, 0, 3], [2]):
        writer = make(shards)
        done = hd.generate(
            scenes[1], cameras, randomizer, writer=writer, indices=indices, **options
        )
    assert done.complete
    one, other = files(whole), files(shards)
    assert list(one) == list(other) and len(one) > 6
    assert [path for path in one if one[path] != other[path]] == []
    again = hd.generate(scenes[1], cameras, randomizer, writer=make(shards), **options)
    assert (again.images, again.complete) == (0, True) and files(shards) == other
