"""Frames that stay on the GPU, against a daemon whose GPU memory is memfds (heliographd-faulty) and
a libcuda that maps them: right, never stale, given back, refused where something is missing."""

import gc
import json
import os
import pathlib
import signal
import subprocess
import sys
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire import shared

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "python"))
import stub_cuda  # noqa: E402

DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", HERE.parents[1] / "build/cpu/bin/heliographd"))
PLANES = ["beauty", "depth", "instance"]
OPTIONS = {"planes": PLANES, "spp": 2, "progress": False, "labels": False}


def build(client):
    scene = client.create_scene()
    with scene.edit() as edit:
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5, segments=16))
        edit.entity("ball", mesh=mesh)
        edit.dome(color=(1, 1, 1))
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
    return scene


def look(scene, k=0, **options):
    """The frame with the ball at place k."""
    with scene.overlay() as overlay:
        overlay.entity("ball", transform=hg.Pose((0.02 * k, 0, 0)))
    return scene.render("cam", overlay=overlay, **(OPTIONS | options))


def content(frame):
    host = frame.cpu()
    return b"".join(host[name].tobytes() for name in PLANES)


def maps(client):
    return client.connection.link.shared._maps


def bytes_of_tenant(client):
    return client.info().used["tenant_bytes"]


@pytest.fixture(scope="module")
def stub(tmp_path_factory):
    with stub_cuda.loaded(tmp_path_factory.mktemp("cuda")) as loaded:
        yield loaded
        gc.collect()
        assert (loaded.depth, loaded.early, loaded.handles) == (0, 0, 0)


@pytest.fixture
def stage(stub, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    with hg.connect() as client:
        yield build(client)


def test_planes_on_the_gpu_have_the_bytes_of_those_on_the_host(stage):
    there, here = look(stage, 3, device="cuda"), look(stage, 3)
    assert content(there) == content(here)
    assert json.loads(there.manifest) == json.loads(here.manifest)
    for name in PLANES:
        plane = there.on_device(name)
        assert plane.shape == here[name].shape and plane.dtype == here[name].dtype
    capability = f"device_memory:cuda:{stub_cuda.UUID.hex()}"
    assert capability in stage.client.info().capabilities


def test_worlds_stay_on_the_gpu_packed(stage):
    poses = np.tile(np.eye(4, dtype="f4"), (5, 1, 1, 1))
    poses[:, 0, 0, 3] = np.arange(5) / 4
    worlds = hg.Worlds(5).set_transforms("ball", poses)
    size = (15, 11)  # a picture does not end where a line of memory does
    there = stage.render_worlds("cam", worlds, device="cuda", size=size, **OPTIONS)
    here = stage.render_worlds("cam", worlds, size=size, **OPTIONS)
    assert there.on_device("beauty").shape == (5, 1, 11, 15, 4)
    assert len(maps(stage.client)) == len(PLANES)
    assert content(there) == content(here)
    with pytest.raises(hg.FailedPrecondition, match="torch"):
        there.frame(3)
    assert there.cpu().frame(3)["depth"].tobytes() == here.frame(3)["depth"].tobytes()


@pytest.mark.parametrize("planes", [["denoised"], ["normal_mean", "denoised", "depth", "beauty"]])
def test_denoised_stays_there_too(stage, planes):
    options = OPTIONS | {"planes": planes}
    there, here = (stage.render("cam", **options, **to) for to in ({"device": "cuda"}, {}))
    assert len(maps(stage.client)) == len(planes) and there.planes == here.planes == planes
    for name in planes:
        assert there.cpu()[name].tobytes() == here[name].tobytes()
    for frame in (there, here):
        assert json.loads(frame.manifest)["denoiser"] == "a test's device"
        assert frame.warnings == []
    worlds = hg.Worlds(3)
    packed = stage.render_worlds("cam", worlds, device="cuda", **options)
    same = stage.render_worlds("cam", worlds, **options)
    assert packed.on_device("denoised").shape == (3, 1, 48, 64, 4)
    assert packed.cpu()["denoised"].tobytes() == same["denoised"].tobytes()
    assert json.loads(packed.manifest)["denoiser"] == "a test's device"


def test_a_device_that_cannot_denoise_says_so(stub, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    monkeypatch.setenv("HELIOGRAPH_TEST_DENOISER", "the driver is too old")
    with hg.connect() as client:
        scene = build(client)
        options = OPTIONS | {"planes": ["denoised"]}
        with pytest.raises(hg.Unimplemented, match="the driver is too old") as caught:
            scene.render("cam", device="cuda", **options)
        assert caught.value.field == "planes"
        frame = scene.render("cam", **options)
        (warning,) = frame.warnings
        assert "on the CPU, as the GPU cannot: the driver is too old" in warning
        assert json.loads(frame.manifest)["denoiser"].endswith("on the CPU")
        assert frame["denoised"].any()


def test_what_is_held_never_changes_and_what_is_not_is_used_again(stage):
    held = [look(stage, k, device="cuda") for k in range(4)]
    before = [content(look(stage, k)) for k in range(4)]
    corner = look(stage, 9, device="cuda").on_device("depth")
    kept = corner.numpy()
    for k in range(20):
        assert content(look(stage, k, device="cuda")) == content(look(stage, k))
    assert [content(frame) for frame in held] == before
    assert np.array_equal(corner.numpy(), kept)
    buffers = len(maps(stage.client))
    assert buffers <= 8 * len(PLANES)
    del held, corner
    gc.collect()
    for k in range(20):
        look(stage, k, device="cuda")
    assert len(maps(stage.client)) == buffers  # none was made


def test_a_plane_that_the_gpu_still_reads_is_not_written(stage, stub):
    frame = look(stage, 1, device="cuda")
    expected = content(frame)
    addresses = {name: frame.on_device(name).pointer for name in PLANES}
    stub.busy = 1  # work on the tensors is in flight when the last of them is gone
    del frame
    gc.collect()
    others = [look(stage, 2 + k, device="cuda") for k in range(5)]
    used = {other.on_device(name).pointer for other in others for name in PLANES}
    assert not used & set(addresses.values())
    stub.busy = 0
    again = {look(stage, 1, device="cuda").on_device(name).pointer for name in PLANES}
    assert expected == content(look(stage, 1, device="cuda")) and again


def test_streams_batches_and_passes_stay_there_too(stage):
    single = content(look(stage))
    with stage.overlay() as overlay:
        overlay.entity("ball", transform=hg.Pose((0, 0, 0)))
    options = OPTIONS | {"device": "cuda", "overlay": overlay}
    options.pop("progress")
    with stage.stream("cam", policy="lossless", **options) as live:
        assert content(next(live)) == single
    jobs = [hg.Job("cam", tag=k, **options) for k in range(4)]
    assert [content(r.frame) for r in stage.render_batch(jobs)] == [single] * 4
    passes = []
    stage.render("cam", on_pass=passes.append, progress=False, **options)
    assert passes and content(passes[-1]) == single


def test_cancelled_calls_leave_no_buffers(stage):
    def cancelled():
        with stage.stream("cam", device="cuda", planes=PLANES, spp=2) as live:
            next(live)

    for _ in range(20):
        cancelled()
    gc.collect()
    look(stage, device="cuda")
    assert len(maps(stage.client)) <= 4 * len(PLANES)


def test_without_room_it_is_refused_never_sent_as_bytes(stub, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    with hg.connect(arguments=["--limit", f"shared_bytes={8 << 20}"]) as client:
        scene = build(client)
        held = [look(scene, device="cuda")]
        with pytest.raises(hg.ResourceExhausted, match="let go of frames"):
            held.append(look(scene, device="cuda"))
        expected = content(look(scene))
        held.clear()
        gc.collect()
        assert content(look(scene, device="cuda")) == expected


@pytest.mark.parametrize(
    ("options", "field", "text"),
    [
        ({"half": ["depth"]}, "planes[1].half", "half float"),
        ({"planes": ["beauty", "sensor_rgb"]}, "planes[1]", "sensor_rgb is made on the host"),
    ],
)
def test_what_is_made_on_the_host_does_not_pretend(stage, options, field, text):
    with pytest.raises(hg.Unimplemented, match=text) as caught:
        look(stage, device="cuda", **options)
    assert caught.value.field == field


def test_a_daemon_that_renders_on_the_host_says_so(stub):
    with hg.connect() as client:
        scene = build(client)
        with pytest.raises(hg.FailedPrecondition, match="--backend cuda") as caught:
            look(scene, device="cuda")
        assert caught.value.field == "memory"
        assert not any("device_memory" in c for c in client.info().capabilities)
        assert len(content(look(scene))) > 0


def test_a_client_that_maps_nothing_is_told(stage, monkeypatch):
    monkeypatch.setattr(shared, "CAPABILITY", "none of these")
    with hg.connect(stage.client.address) as other:
        with pytest.raises(hg.FailedPrecondition, match="Unix socket"):
            look(build(other), device="cuda")
        jobs = [hg.Job("cam", device="cuda", planes=PLANES, spp=1)]
        (result,) = build(other).render_batch(jobs)
        assert result.error.field == "job.memory"


def test_a_daemon_that_records_refuses(stub, monkeypatch, tmp_path):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    with hg.connect(arguments=["--record", str(tmp_path / "out")]) as client:
        with pytest.raises(hg.FailedPrecondition, match="--record"):
            look(build(client), device="cuda")


def test_a_lost_device_takes_its_free_buffers_with_it(stage):
    held = look(stage, 5, device="cuda")
    expected = content(held)
    kept = set(maps(stage.client))
    look(stage, 6, device="cuda")
    gc.collect()
    free = set(maps(stage.client)) - kept
    assert len(free) == len(PLANES)
    os.kill(stage.client.connection.daemon._process.pid, signal.SIGUSR1)
    with pytest.raises(hg.Unavailable):
        for _ in range(1000):  # until the signal has arrived
            look(stage, 1)
    until = time.monotonic() + 10
    while time.monotonic() < until:
        try:
            frame = look(stage, 1, device="cuda")
            break
        except (hg.Unavailable, hg.FailedPrecondition):
            time.sleep(0.1)
    assert content(frame) == content(look(stage, 1))
    assert not free & set(maps(stage.client)) and content(held) == expected


CHILD = """
import os, sys, time
sys.path[:0] = {paths!r}
import heliograph as hg
from heliograph._wire import cuda as _cuda
import test_device_frames as t
_cuda.LIBRARY = {library!r}
client = hg.connect({address!r})
scene = t.build(client)
held = [t.look(scene, k, device="cuda") for k in range(5)]
print("ready", flush=True)
time.sleep(60)
"""


def test_a_client_that_is_killed_leaves_nothing(stub, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(DAEMON.with_name("heliographd-faulty")))
    from heliograph._wire import cuda

    with hg.connect(arguments=["--grace", "0.5"]) as client:
        before = bytes_of_tenant(client)
        text = CHILD.format(
            paths=[str(HERE), str(HERE.parent / "python"), *sys.path],
            library=cuda.LIBRARY,
            address=client.address,
        )
        child = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True)
        assert child.stdout.readline().strip() == "ready"
        assert bytes_of_tenant(client) >= before + 15 * (2 << 20)
        child.kill()
        child.wait()
        until = time.monotonic() + 20
        kept = before + (1 << 20)  # what the device keeps of the scenes that it showed last
        while bytes_of_tenant(client) > kept and time.monotonic() < until:
            time.sleep(0.1)
        assert bytes_of_tenant(client) <= kept
