"""Edits and frames that the Python client asks for by quick calls, and when it goes by gRPC."""

from __future__ import annotations

import os
import signal
import threading
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire.quick import FastPathConnection

LENS = hg.Camera.from_fov(50, 320, 240, degrees=True)


class Asked:
    """Quick calls: True for each that was answered so."""

    def __init__(self, monkeypatch):
        self.answered: list[bool] = []
        ask = FastPathConnection.ask

        def spy(line, call, on_progress=None):
            reply = ask(line, call, on_progress)
            self.answered.append(reply is not None)
            return reply

        monkeypatch.setattr(FastPathConnection, "ask", spy)


@pytest.fixture
def asked(monkeypatch):
    return Asked(monkeypatch)


@pytest.fixture
def scene(scene):
    with scene.edit() as edit:
        mesh = edit.mesh("ball", **hg.shapes.sphere(0.4))
        poses = np.tile(np.eye(4), (2000, 1, 1))
        poses[:, 0, 3] = np.arange(2000)
        edit.instances("b", mesh=mesh, transforms=poses)
        edit.entity("cam", camera=LENS, transform=hg.Pose((0, 0, 3)))
        edit.dome(color=(1, 1, 1))
    return scene


def by_grpc(scene, *arguments, **options):
    line, scene.client.connection.link.quick = scene.client.connection.link.quick, None
    try:
        return scene.render(*arguments, **options)
    finally:
        scene.client.connection.link.quick = line


def test_frames_are_those_of_grpc(scene, asked):
    options = {"planes": ["beauty", "depth", "instance"], "labels": True, "spp": 2}
    quick = scene.render("cam", **options)
    assert asked.answered == [True]
    usual = by_grpc(scene, "cam", **options)
    for plane in options["planes"]:
        np.testing.assert_array_equal(quick[plane], usual[plane])
    assert quick.labels.keys() == usual.labels.keys()
    for name, column in usual.labels.items():
        np.testing.assert_array_equal(quick.labels[name], column)
    assert len(scene.render(["cam", "cam"], planes=["depth"])) == 2


def test_edits_count_on(scene, asked):
    before = scene.revision
    for k in range(5):
        with scene.edit() as edit:
            edit.entity("b0", transform=hg.Pose((k, 0, 0)))
        line, scene.client.connection.link.quick = scene.client.connection.link.quick, None
        with scene.edit() as edit:  # the same numbering, by gRPC
            edit.entity("b1", transform=hg.Pose((k, 0, 0)))
        scene.client.connection.link.quick = line
    assert asked.answered == [True] * 5
    assert scene.revision == before + 10


def test_errors_are_typed(scene, asked):
    with pytest.raises(hg.NotFound) as error:
        scene.render("came", planes=["depth"])
    assert error.value.field == "cameras[0]" and "cam" in error.value.nearest
    with pytest.raises(hg.InvalidArgument), scene.edit() as edit:
        edit.entity("b0", transform=np.full((4, 4), np.nan))
    with pytest.raises(hg.NotFound), scene.edit() as edit:
        edit.entity("b0", mesh="nothing")
    with scene.edit() as edit:
        edit.entity("b0", transform=hg.Pose((1, 0, 0)))
    assert asked.answered[0] and asked.answered[-1]


def test_what_is_large_or_watched_goes_by_grpc(scene, asked):
    with scene.overlay() as overlay:
        for k in range(2000):
            overlay.entity(f"b{k}", transform=hg.Pose((k * 1e-3, 0, 0)))
    scene.render("cam", planes=["depth"], overlay=overlay)
    scene.render("cam", planes=["depth"], timeout=20)
    scene.render("cam", spp=2, on_pass=lambda frame: None)
    assert asked.answered == []


def test_progress_is_told(scene, asked):
    reports = []
    frame = scene.render("cam", seconds=0.5, spp=1 << 20, progress=reports.append)
    assert asked.answered == [True]
    assert len(reports) > 2 and all(isinstance(each, hg.Progress) for each in reports)
    assert [each.done for each in reports] == sorted(each.done for each in reports)
    assert reports[-1].rays_per_second > 0 and frame["beauty"].shape == (240, 320, 4)
    with pytest.raises(ZeroDivisionError):
        scene.render("cam", seconds=60, spp=1 << 20, progress=lambda each: 1 / 0)
    assert scene.render("cam", planes=["depth"])["depth"].shape == (240, 320)
    assert asked.answered[-1]


def test_closing_the_client_ends_a_call_of_another_thread():
    with hg.connect() as client:
        scene, ended = client.create_scene(), []
        with scene.edit() as edit:
            edit.entity("cam", camera=LENS)
            edit.dome(color=(1, 1, 1))

        def work():
            try:
                scene.render("cam", seconds=60, spp=1 << 20)
            except hg.Unavailable as error:
                ended.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        time.sleep(0.3)
        client.close()
        thread.join(10)
        assert len(ended) == 1


def test_threads_share_a_session(scene, asked):
    def work(k):
        for step in range(20):
            with scene.overlay() as overlay:
                overlay.entity("cam", transform=hg.Pose((0, 0, 3 + k + step)))
            depth = scene.render("cam", planes=["depth"], overlay=overlay)["depth"]
            good[k] += abs(np.nanmin(depth) - (2.6 + k + step)) < 0.02

    good = [0] * 6
    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(good))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert good == [20] * 6
    assert any(asked.answered)


def test_an_interrupt_cancels_the_call(scene):
    def calls():
        return sum(use.calls for use in scene.client.sessions())

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            scene.render("cam", seconds=60, spp=1 << 20)
    finally:
        signal.signal(signal.SIGALRM, before)
    end = time.monotonic() + 5
    while calls() and time.monotonic() < end:
        time.sleep(0.01)
    assert calls() == 0
    assert scene.render("cam", planes=["depth"])["depth"].shape == (240, 320)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_has_a_socket_of_its_own(scene, asked):
    scene.render("cam", planes=["depth"])
    child = os.fork()
    if child == 0:
        with scene.client.create_scene() as own:
            with own.edit() as edit:
                edit.entity("cam", camera=LENS)
            own.render("cam", planes=["depth"])
        os._exit(0 if asked.answered == [True] * 3 else 1)
    for _ in range(20):
        scene.render("cam", planes=["depth"])
    assert os.waitpid(child, 0)[1] == 0
    assert asked.answered == [True] * 21


def test_a_daemon_that_dies_says_so():
    with hg.connect() as client:
        scene = client.create_scene()
        with scene.edit() as edit:
            edit.entity("cam", camera=LENS)
        scene.render("cam", planes=["depth"])
        os.kill(client.connection.daemon._process.pid, signal.SIGKILL)
        with pytest.raises(hg.Unavailable, match="died"):
            scene.render("cam", planes=["depth"])
