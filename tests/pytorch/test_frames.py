"""heliograph.torch against a daemon: the same images whoever makes them, errors, shutdown."""

import gc
import multiprocessing
import threading
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
import torch

PLANES = ["beauty", "depth", "instance", "normal"]
OPTIONS = {"planes": PLANES, "spp": 2, "seed": 5}


def scatter(draw):
    """Moves and paints the balls; slower for some images, so that they are done out of order."""
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :2, 3] = draw.rng.uniform(-0.8, 0.8, (3, 2))
    poses[:, 2, 3] = 0.2
    draw.place(["ball/0", "ball/1", "ball/2"], poses)
    draw.edit.material("paint", base_color=draw.rng.uniform(0.1, 0.9, 3))
    time.sleep(0.01 * (draw.index % 3))


def fail_at_four(draw):
    if draw.index == 4:
        raise KeyError("no such thing")


def ask_wrongly_at_four(draw):
    draw.edit.material("paint", roughness=2.0 if draw.index == 4 else 0.5)


@pytest.fixture(scope="module")
def client():
    with hg.connect() as connected:
        yield connected


@pytest.fixture
def scene(client):
    with client.create_scene() as made:
        with made.edit() as edit:
            edit.sample_studio()
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
            edit.material("paint")
            poses = np.tile(np.eye(4), (3, 1, 1))
            edit.instances("ball", mesh=mesh, material="paint", transforms=poses, category="ball")
            lens = hg.Camera.from_fov(50, 32, 24, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.2)))
            edit.entity("side", camera=lens, transform=hg.look_at((3, 0, 1.5), (0, 0, 0.2)))
        yield made


def same(batches, others):
    assert len(batches) == len(others)
    for batch, other in zip(batches, others, strict=True):
        assert batch.keys() == other.keys()
        for name in batch.keys() - {"labels"}:
            assert torch.equal(torch.nan_to_num(batch[name]), torch.nan_to_num(other[name])), name
        for labels, more in zip(batch["labels"], other["labels"], strict=True):
            assert torch.equal(labels["bbox_visible"], more["bbox_visible"])
            assert labels["name"] == more["name"]
    return True


def test_the_same_batches_for_any_number_of_workers(scene):
    frames = hg.torch.Frames(scene, "cam", scatter, count=10, **OPTIONS)
    alone = list(hg.torch.loader(frames, 3))
    assert [batch["index"].tolist() for batch in alone] == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9]]
    assert not torch.equal(alone[0]["beauty"][0], alone[0]["beauty"][1])
    for workers in (1, 3):
        assert same(list(hg.torch.loader(frames, 3, num_workers=workers)), alone)
    spawned = hg.torch.loader(frames, 3, num_workers=2, multiprocessing_context="spawn")
    assert same(list(spawned), alone)


def test_they_are_the_images_of_generate(scene, tmp_path):
    kept = {}

    class Keep(hd.Writer):
        planes = tuple(PLANES)

        def write(self, image):
            kept[image.index] = image.frame["beauty"]

    hd.generate(scene, ["cam", "side"], scatter, count=6, writer=Keep(tmp_path), spp=2, seed=5)
    frames = hg.torch.Frames(scene, ["cam", "side"], scatter, start=2, count=4, **OPTIONS)
    seen = {item["index"]: item["beauty"].numpy() for item in frames}
    assert list(seen) == [2, 3, 4, 5]
    for index, beauty in seen.items():
        assert np.array_equal(beauty, np.moveaxis(kept[index], -1, 0))


def test_what_an_item_is(scene):
    batch = next(iter(hg.torch.loader(hg.torch.Frames(scene, "cam", scatter, **OPTIONS), 2)))
    shapes = {name: tuple(batch[name].shape) for name in batch if name != "labels"}
    assert shapes == {
        "index": (2,),
        "beauty": (2, 4, 24, 32),
        "depth": (2, 24, 32),
        "instance": (2, 24, 32),
        "normal": (2, 3, 24, 32),
        "K": (2, 3, 3),
        "camera_from_world_cv": (2, 4, 4),
    }
    assert batch["instance"].dtype == torch.int64 and batch["beauty"].dtype == torch.float32
    labels = batch["labels"][1]
    assert labels["name"] == ["ball/0", "ball/1", "ball/2"]
    assert labels["bbox_visible"].shape == (3, 4)
    batch["beauty"].mul_(2)  # its own memory


def test_an_item_of_ones_own_and_accept(scene):
    frames = hg.torch.Frames(
        scene,
        "cam",
        scatter,
        count=3,
        item=lambda image: image.frame.labels["visibility"].min(),
        accept=lambda labels: (labels["visibility"] > 0.9).all(),
        **OPTIONS,
    )
    assert all(least > 0.9 for least in frames)


def test_ranks_share_the_images(scene):
    def of(rank, ranks):
        frames = hg.torch.Frames(
            scene, "cam", scatter, count=11, rank=rank, ranks=ranks, block=2, spp=1
        )
        indices = [item["index"] for item in frames]
        assert len(frames) == len(indices)
        return indices

    assert of(0, 2) == [0, 1, 4, 5] and of(1, 2) == [2, 3, 6, 7]
    with pytest.raises(hg.InvalidArgument, match="rank"):
        hg.torch.Frames(scene, "cam", scatter, rank=1)


def test_edits_meanwhile_change_nothing(scene):
    frames = hg.torch.Frames(scene, "cam", scatter, count=4, **OPTIONS)
    before = list(hg.torch.loader(frames, 2))
    for blue in range(100):  # more than the revisions that a daemon keeps
        with scene.edit() as edit:
            edit.dome(color=(0, 0, blue / 99))
    assert same(list(hg.torch.loader(frames, 2)), before)


def test_loaders_of_the_same_frames_do_not_meet(scene):
    frames = hg.torch.Frames(scene, "cam", scatter, count=4, **OPTIONS)
    pairs = hg.torch.loader(frames, 2, num_workers=2)
    singles = hg.torch.loader(frames, 1)
    assert [batch["index"].tolist() for batch in pairs] == [[0, 1], [2, 3]]
    assert [batch["index"].tolist() for batch in singles] == [[0], [1], [2], [3]]


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_the_branch_goes_with_the_last_that_has_it(client, scene, context):
    frames = hg.torch.Frames(scene, "cam", scatter, count=2, **OPTIONS)
    branch = frames.scene.id
    batches = hg.torch.loader(frames, 1, num_workers=2, multiprocessing_context=context)
    del frames
    for _ in range(2):
        assert len(list(batches)) == 2
    assert branch in [left.id for left in client.scenes()]
    del batches
    assert branch not in [left.id for left in client.scenes()]


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize(
    ("randomizer", "kind", "message"),
    [
        (fail_at_four, RuntimeError, "image 4: KeyError: 'no such thing'"),
        (ask_wrongly_at_four, hg.InvalidArgument, "image 4: .*roughness"),
    ],
)
def test_an_error_names_its_image(scene, randomizer, kind, message, workers):
    frames = hg.torch.Frames(scene, "cam", randomizer, count=8, spp=1)
    batches = iter(hg.torch.loader(frames, 1, num_workers=workers))
    assert [next(batches)["index"].item() for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(kind, match=message):
        next(batches)
    if workers:
        batches._shutdown_workers()  # the exception holds it, which would go on until collected


@pytest.mark.parametrize("workers", [0, 2])
def test_leaving_early_leaves_nothing_behind(client, scene, workers):
    gc.collect()  # errors of the tests before hold their Frames
    frames = hg.torch.Frames(scene, "cam", scatter, **OPTIONS)  # without end
    batches = iter(hg.torch.loader(frames, 2, num_workers=workers))
    next(batches)
    del batches
    deadline = time.monotonic() + 5  # a session that is gone is kept for 10 s, with its scenes
    while len(client.scenes()) > 2 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert {left.id for left in client.scenes()} == {scene.id, frames.scene.id}
    assert not multiprocessing.active_children()
    assert not [t for t in threading.enumerate() if t.name.startswith("heliograph-work")]


def test_what_is_refused(scene):
    with pytest.raises(hg.InvalidArgument, match="overlay"):
        hg.torch.Frames(scene, "cam", scatter, overlay=None)
    on_gpu = hg.torch.Frames(scene, "cam", scatter, count=2, device="cuda")
    with pytest.raises(hg.InvalidArgument, match="num_workers=0"):
        list(hg.torch.loader(on_gpu, 1, num_workers=1))
    with pytest.raises(TypeError, match="count"):
        len(hg.torch.Frames(scene, "cam", scatter))
