"""Poses that come from arrays on a GPU, against a daemon whose GPU memory is memfds: the same scene
as from the host, also when a buffer is used again, in overlays, and after a restart."""

import gc
import json

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import types_pb2 as types
from test_device_frames import DAEMON, stub

__all__ = ["stub"]
COUNT = 50
OPTIONS = {"planes": ["depth"], "labels": False}


class OnGpu:
    """The array interface of PyTorch's tensors; the stub's GPU has the host's memory."""

    def __init__(self, data, **more):
        self.data = np.ascontiguousarray(data)
        self.__cuda_array_interface__ = {
            "shape": self.data.shape,
            "typestr": self.data.dtype.str,
            "data": (self.data.ctypes.data, False),
            "version": 2,
        } | more


def places(k, count=COUNT, dtype="f4"):
    out = np.tile(np.eye(4), (count, 1, 1))
    out[:, :3, 3] = np.random.default_rng(k).uniform(-1, 1, (count, 3))
    return out.astype(dtype)


def build(client, **options):
    scene = client.create_scene(**options)
    with scene.edit() as edit:
        edit.mesh("mesh", **hg.shapes.sphere(0.1, segments=8))
        edit.dome(color=(1, 1, 1))
        edit.instances("ball", mesh="mesh", transforms=places(0))
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
    return scene, [f"ball/{i}" for i in range(COUNT)]


@pytest.fixture
def stage(stub, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    with hg.connect() as client:
        yield build(client)


def rooms(scene):
    return len(scene.client.connection.link.shared._maps)


def seen(scene):
    return scene.render("cam", planes=["depth"], labels=False, progress=False)["depth"].tobytes()


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_poses_from_the_gpu_are_those_from_the_host(stage, stub, dtype):
    scene, balls = stage
    for k in range(1, 12):
        with scene.edit() as edit:
            edit.set_transforms(balls, OnGpu(places(k, dtype=dtype), stream=7))
        assert np.array_equal(scene.transforms(balls), places(k))
        there = seen(scene)
        with scene.edit() as edit:
            edit.set_transforms(balls, places(k))
        assert seen(scene) == there
    assert stub.stream == 7
    assert rooms(scene) <= 4  # two that are written in turn, and what frames lie in


def test_new_instances_may_come_from_the_gpu(stage):
    scene, _ = stage
    with scene.edit() as edit:
        group = edit.instances("more", mesh="mesh", transforms=OnGpu(places(3, 7)))
    assert np.array_equal(scene.transforms(group), places(3, 7))


def test_vertices_may_come_from_the_gpu(stage):
    scene, _ = stage
    sphere = hg.shapes.sphere(0.1, segments=8)
    bent = (sphere["positions"] * (1, 2, 3)).astype("f4")
    normals = (bent / np.linalg.norm(bent, axis=1, keepdims=True)).astype("f4")
    before = seen(scene)
    with scene.edit() as edit:
        edit.mesh("mesh", positions=OnGpu(bent), normals=OnGpu(normals))
    assert np.array_equal(scene["mesh"].positions, bent)
    assert np.array_equal(scene["mesh"].normals, normals)
    there = seen(scene)
    with scene.edit() as edit:
        edit.mesh("mesh", positions=bent, normals=normals)
    assert seen(scene) == there != before
    bent[3, 1] = np.inf
    with pytest.raises(hg.InvalidArgument, match=r"positions\[3\]"), scene.edit() as edit:
        edit.mesh("mesh", positions=OnGpu(bent))
    with pytest.raises(hg.InvalidArgument, match="float32"), scene.edit() as edit:
        edit.mesh("mesh", positions=OnGpu(bent.astype("f8")))


def test_an_overlay_keeps_what_it_was_given(stage):
    scene, balls = stage
    tensor = OnGpu(places(5))
    with scene.overlay() as overlay:
        overlay.set_transforms(balls, tensor)
    tensor.data[:] = places(6)  # the overlay has a copy
    options = {"overlay": overlay, "planes": ["depth"], "labels": False, "progress": False}
    frames = [scene.render("cam", **options) for _ in range(3)]
    with scene.edit() as edit:
        edit.set_transforms(balls, places(5))
    assert {frame["depth"].tobytes() for frame in frames} == {seen(scene)}
    assert "overlay" not in json.loads(frames[0].manifest)["request"]
    with pytest.raises(hg.InvalidArgument, match="overlay"):
        scene.rerender(frames[0].manifest)


def test_worlds_take_their_poses_from_the_gpu(stage):
    scene, balls = stage
    poses = np.stack([places(k) for k in range(4)])
    options = {"planes": ["depth"], "labels": False, "progress": False}
    worlds = hg.Worlds(4).set_transforms(balls, OnGpu(poses))
    there = [scene.render_worlds("cam", worlds, **options) for _ in range(2)]
    here = scene.render_worlds("cam", hg.Worlds(4).set_transforms(balls, poses), **options)
    jobs = [hg.Job("cam", worlds=worlds, tag=k, **OPTIONS) for k in range(3)]
    there += [result.frame for result in scene.render_batch(jobs)]
    stayed = scene.render_worlds("cam", worlds, device="cuda", **options)
    assert stayed.on_device("depth").shape == here["depth"].shape
    for frame in (*there, stayed.cpu()):
        assert np.array_equal(frame["depth"], here["depth"])


def test_what_is_wrong_is_said_as_for_the_host(stage):
    scene, balls = stage
    bad = places(1)
    bad[3, 1, 2] = np.nan

    def refused(error, text, **calls):
        with pytest.raises(error, match=text), scene.edit() as edit:
            for name, arguments in calls.items():
                getattr(edit, name)(*arguments)

    refused(hg.InvalidArgument, r"\[3\]", set_transforms=(balls, OnGpu(bad)))
    refused(hg.InvalidArgument, "49 matrices", set_transforms=(balls, OnGpu(places(1, 49))))
    refused(hg.InvalidArgument, r"shape \(N, 4, 4\)", set_transforms=(balls, OnGpu(bad[0])))
    refused(hg.InvalidArgument, "float16", set_transforms=(balls, OnGpu(places(1, dtype="f2"))))
    strides = OnGpu(places(1), strides=(64, 4, 16))
    refused(hg.InvalidArgument, "contiguous", set_transforms=(balls, strides))
    with pytest.raises(hg.Unimplemented, match="publish"), scene.edit() as edit:
        made = edit.entity("new")
        edit.set_transforms([made], OnGpu(places(1, 1)))
    assert np.array_equal(scene.transforms(balls), places(0))


def test_a_buffer_is_its_sessions_own(stage):
    scene, balls = stage
    with scene.edit() as edit:
        edit.set_transforms(balls, OnGpu(places(1)))
        lent = edit.transaction.edits[0].poses.matrices.buffer
    with hg.connect(scene.client.address) as other:
        theirs, _ = build(other)
        for place in (lent, types.BufferRef(buffer=1, generation=1, size=lent.size)):
            with pytest.raises(hg.NotFound, match="LendBuffer"), theirs.edit() as edit:
                edit.set_transforms(balls, places(2))
                matrices = edit.transaction.edits[0].poses.matrices
                matrices.ClearField("source")
                matrices.buffer.CopyFrom(place)


def test_a_durable_scene_keeps_what_came_from_the_gpu(stub, monkeypatch, tmp_path):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    arguments = ["--state-dir", str(tmp_path / "state")]
    with hg.connect(arguments=arguments) as client:
        scene, balls = build(client, name="kept", lifetime="disk_synced")
        for k in (1, 2, 3):
            with scene.edit() as edit:
                edit.set_transforms(balls, OnGpu(places(k)))
        bad = places(4)
        bad[0, 0, 0] = np.inf
        room = OnGpu(bad)
        with pytest.raises(hg.InvalidArgument), scene.edit() as edit:
            edit.set_transforms(balls, room)
        with scene.edit() as edit:
            edit.set_transforms(balls, OnGpu(places(5)))
        assert np.array_equal(scene.transforms(balls), places(5))
        del edit
    gc.collect()
    with hg.connect(arguments=arguments) as client:
        scene = client.open_scene("kept")
        assert np.array_equal(scene.transforms(balls), places(5))


@pytest.mark.parametrize("arguments", [[], ["--record"]], ids=["on the CPU", "recording"])
def test_a_daemon_that_cannot_says_why(stub, monkeypatch, tmp_path, arguments):
    if arguments:
        monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
        arguments = [*arguments, str(tmp_path / "out")]
    with hg.connect(arguments=arguments) as client:
        scene, balls = build(client)
        with pytest.raises(hg.FailedPrecondition, match="from the host"), scene.edit() as edit:
            edit.set_transforms(balls, OnGpu(places(1)))
        with scene.edit() as edit:
            edit.set_transforms(balls, places(1))
        assert np.array_equal(scene.transforms(balls), places(1))
