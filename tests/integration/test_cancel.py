"""A cancelled call frees the device, whatever it was doing. 50 ms are promised, and bench/cancel.py
measures them; here a machine with other work may take its time."""

import threading
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire._proto import types_pb2 as types

SOON = 0.5  # seconds


@pytest.fixture(scope="module")
def scenes(client):
    """A scene of 62,500 balls that no device has seen, and a tiny one."""
    with client.create_scene() as heavy, client.create_scene() as tiny:
        poses = np.tile(np.eye(4), (62_500, 1, 1))
        poses[:, 0, 3], poses[:, 1, 3] = np.mgrid[0:250, 0:250].reshape(2, -1)
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        for scene, count in ((heavy, len(poses)), (tiny, 1)):
            with scene.edit() as edit:
                mesh = edit.mesh("sphere", **hg.shapes.sphere(0.4, segments=96))
                edit.instances("ball", mesh=mesh, transforms=poses[:count])
                edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 20)))
        tiny.render("cam", planes=["depth"])
        yield heavy, tiny


CALLS = {
    "samples": {"spp": 1 << 20},
    "deep samples": {"spp": 1 << 20, "max_depth": 512, "roulette": False},
    "centre planes": {"planes": ["depth", "normal", "uv", "part"], "size": (4096, 4096)},
    "amodal masks": {"planes": ["instance"], "labels": ["amodal"], "size": (4096, 2160)},
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("delay", [0.02, 0.15])
def test_a_cancelled_job_frees_the_device(scenes, name, delay):
    heavy, tiny = scenes
    cancel, ended = [], []

    def work():
        try:
            heavy.render("cam", on_start=cancel.append, **{"size": (1280, 720), **CALLS[name]})
        except hg.HeliographError as error:
            ended.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    while not cancel:
        time.sleep(0.001)
    time.sleep(delay)
    start = time.monotonic()
    cancel[0]()
    tiny.render("cam", planes=["depth"])
    took = time.monotonic() - start
    thread.join()
    assert took < SOON, f"{1000 * took:.0f} ms"
    assert all(isinstance(error, hg.Cancelled) for error in ended)


@pytest.mark.parametrize("name", CALLS)
def test_a_deadline_is_kept(scenes, name):
    heavy, tiny = scenes
    start = time.monotonic()
    options = {"size": (1280, 720), **CALLS[name], "timeout": 0.1}
    with pytest.raises(hg.DeadlineExceeded):
        heavy.render("cam", **options)
    tiny.render("cam", planes=["depth"])
    assert time.monotonic() - start < 0.1 + SOON


@pytest.fixture
def long_query(scenes):
    """Four million samples of a thousand surfaces: seconds of work in one call."""
    heavy, _ = scenes
    link = heavy.client.connection.link
    refs = [types.Ref(name=f"ball/{i}") for i in range(1000)]
    question = service.SampleSurface(entities=refs, count=1 << 12)
    request = service.QueryRequest(scene=heavy.id, sample_surface=question)
    call = link.method("Query")(request, metadata=link.metadata)
    time.sleep(0.2)
    assert call.is_active()
    yield call
    call.cancel()


def test_a_cancelled_query_frees_the_device(scenes, long_query):
    start = time.monotonic()
    long_query.cancel()
    scenes[1].render("cam", planes=["depth"])
    assert time.monotonic() - start < SOON


@pytest.mark.usefixtures("long_query")
def test_a_long_query_holds_up_no_frame(scenes):
    start = time.monotonic()
    scenes[1].render("cam", planes=["depth"])
    assert time.monotonic() - start < SOON
