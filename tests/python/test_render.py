"""Frames: assembly, pictures, files, progress, cancelling."""

import asyncio
import os
import pickle
import signal
import threading

import heliograph as hg
import heliograph.aio
import numpy as np
import pytest
from heliograph import tonemap
from heliograph._wire._proto import render_pb2
from heliograph.render._chunk_span import chunk_span


def test_planes_arrive_as_they_were_sent(daemon, scene):
    frame = scene.render("cam", spp=4, planes=["beauty", "depth", "normal", "instance"])
    assert frame["beauty"].shape == (48, 64, 4) and frame["depth"].shape == (48, 64)
    assert frame["instance"].dtype == np.uint32
    for name, sent in zip(frame.planes, daemon.sent, strict=True):
        assert np.array_equal(frame[name], sent.reshape(frame[name].shape))
        assert not frame[name].flags.writeable
    assert frame.samples == 4 and frame.K.shape == (3, 3)
    assert np.allclose(frame.camera_from_world_gl, np.diag([1, -1, -1, 1]))
    with pytest.raises(KeyError, match="ask for it"):
        frame["uv"]


def test_several_cameras_give_a_list(scene):
    frames = scene.render(["left", "right"], spp=1, size=(8, 8))
    assert len(frames) == 2 and frames[0]["beauty"].shape == (8, 8, 4)


def test_what_the_request_says(daemon, scene):
    scene.render("cam", planes=["depth", "disparity:right"], size=(32, 16), seed=7, time=0.5)
    sent = daemon.requests[-1]
    assert (sent.width, sent.height, sent.seed, sent.time) == (32, 16, 7, 0.5)
    assert sent.planes[1].camera.name == "right" and sent.labels.boxes
    assert not sent.HasField("spp")
    scene.render("cam")
    sent = daemon.requests[-1]
    assert sent.spp == 64 and not sent.HasField("labels")
    scene.render("cam", spp=1, labels=["amodal_masks"], filter="box", max_depth=3)
    sent = daemon.requests[-1]
    assert sent.labels.amodal_masks and sent.filter == render_pb2.PIXEL_FILTER_BOX


def test_of_a_daemon_that_does_not_tell_all_is_asked_for(daemon):
    del daemon.server.planes[:]
    with hg.connect(daemon.address) as client:
        client.create_scene("demo").render("cam", planes=["depth"])
    sent = daemon.requests[-1]
    assert sent.spp == 64 and sent.labels.boxes


def test_rerender_sends_the_manifests_request(daemon, scene):
    request = '{"seed": "9", "spp": 4, "width": 8, "height": 6, "revision": "3", "cameras": '
    request += '[{"name": "cam"}], "planes": [{"plane": "PLANE_BEAUTY"}]}'
    frame = scene.rerender('{"format": "heliograph.manifest.v1", "request": ' + request + "}")
    sent = daemon.requests[-1]
    assert frame["beauty"].shape == (6, 8, 4) and sent.seed == 9 and not sent.HasField("revision")
    with pytest.raises(hg.InvalidArgument, match="overlay"):
        scene.rerender('{"overlay": "1234", "request": ' + request + "}")
    for text in ("", "[]", "{}", '{"request": {"no_such": 1}}'):
        with pytest.raises(hg.InvalidArgument, match="manifest"):
            scene.rerender(text)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"planes": ["dept"]}, "nearest are depth"),
        ({"spp": 0}, "spp"),
        ({"labels": ["boxe"]}, "labels"),
        ({"filter": "sinc"}, "filter"),
        ({"sp": 1}, "did you mean spp"),
        ({"samples": 1}, "render has no 'samples'; there are .*spp"),
    ],
)
def test_bad_options(scene, options, message):
    with pytest.raises(hg.InvalidArgument, match=message):
        scene.render("cam", **options)


def test_chunks_are_read_by_hand_as_protobuf_reads_them():
    for plane, offset, data in [(0, 0, b""), (3, 1 << 40, b"x" * 300), (200, 7, b"\x12\x22")]:
        part = render_pb2.FramePart()
        part.chunk.plane, part.chunk.offset, part.chunk.chunk = plane, offset, data
        raw = part.SerializeToString()
        span = chunk_span(raw)
        assert span is not None
        assert span[:2] == (plane, offset) and raw[span[2] : span[2] + span[3]] == data
    assert chunk_span(render_pb2.FramePart(progress={}).SerializeToString()) is None


def test_labels(scene):
    frame = scene.render("cam", spp=1)
    assert frame.labels["label"].tolist() == [1, 2]
    assert frame.labels.bbox_visible.shape == (2, 4)
    assert frame.instances == {1: "bolt/0", 2: "bolt/1"}
    with pytest.raises(KeyError, match="labels=True"):
        frame.labels["visibility"]


def test_progress_callback(scene):
    seen = []
    scene.render("cam", spp=1, progress=seen.append)
    assert seen[0].done == 0.5 and seen[0].rays_per_second == 1e6


def test_ctrl_c_cancels_the_job_and_leaves_the_client_usable(daemon, scene):
    def interrupt(progress):
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        scene.render("cam", seconds=1000, progress=interrupt)
    assert daemon.cancelled.wait(2)
    assert scene.render("cam", spp=1).samples == 1


def test_timeout(scene):
    with pytest.raises(hg.DeadlineExceeded):
        scene.render("cam", seconds=1000, timeout=0.2)


def test_sequence_is_of_one_revision(daemon, scene):
    with scene.edit() as edit:
        edit.entity("a")
    times = [f.time for f in scene.render_sequence("cam", [0, 1, 2], spp=1)]
    sent = [r for r in daemon.requests if isinstance(r, render_pb2.RenderRequest)]
    assert len(times) == 3 and [r.time for r in sent] == [0, 1, 2]
    assert {r.revision for r in sent} == {1}


def test_frames_pickle_and_outlive_the_client(daemon):
    with hg.connect(daemon.address) as client:
        frame = client.create_scene().render("cam", spp=1)
    twin = pickle.loads(pickle.dumps(frame))
    assert np.array_equal(twin["beauty"], frame["beauty"])
    assert twin.instances == frame.instances


def test_files(scene, tmp_path):
    frame = scene.render("cam", spp=1, planes=["beauty", "depth", "normal", "instance"])
    written = frame.save(tmp_path / "out.png")
    names = ["out.png", "out.depth.png", "out.normal.png", "out.instance.png"]
    assert [path.name for path in written] == names
    from PIL import Image

    assert Image.open(tmp_path / "out.png").size == (64, 48)
    frame.save(tmp_path / "out.npz")
    assert np.array_equal(np.load(tmp_path / "out.npz")["depth"], frame["depth"])
    with pytest.raises(hg.InvalidArgument, match=r"\.exr"):
        frame.save(tmp_path / "out.bmp")
    assert frame.annotated().shape == (48, 64, 3)


def test_exr_holds_every_plane_as_it_is(scene, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    frame = scene.render("cam", spp=1, planes=["beauty", "depth", "normal", "instance"])
    frame.save(tmp_path / "out.exr")
    with OpenEXR.File(str(tmp_path / "out.exr"), separate_channels=True) as file:
        parts = {part.name(): part for part in file.parts}
        assert list(parts) == frame.planes
        assert np.array_equal(parts["depth"].channels["depth"].pixels, frame["depth"])
        assert parts["instance"].channels["instance"].pixels.dtype == np.uint32
        assert np.array_equal(parts["normal"].channels["Z"].pixels, frame["normal"][..., 2])
        assert np.array_equal(parts["beauty"].channels["A"].pixels, frame["beauty"][..., 3])
        assert parts["beauty"].header["manifest"] == frame.manifest


def test_srgb():
    ramp = np.array([[[0, 0.18, 1], [2, -1, np.nan]]], dtype="f4")
    assert tonemap.to_srgb8(ramp, 0, "standard").tolist() == [[[0, 118, 255], [255, 0, 0]]]
    assert tonemap.to_srgb8(ramp, 1, "standard")[0, 0, 1] == 162
    for view in tonemap.VIEWS:
        grey = np.repeat(np.linspace(0, 8, 64, dtype="f4")[None, :, None], 3, axis=2)
        encoded = tonemap.to_srgb8(grey, 0, view).astype(int)
        assert (np.diff(encoded[0, :, 1]) >= 0).all() and encoded[0, -1].min() > 200
    rgb = np.full((4, 4, 3), 0.045, dtype="f4")
    assert tonemap.auto_exposure(rgb, np.ones((4, 4))) == pytest.approx(2)


def test_async_twins(daemon):
    async def work():
        async with await hg.aio.connect(daemon.address) as client:
            scene = await client.create_scene("demo")
            edits = []
            for k in range(10):
                async with scene.edit() as edit:
                    edits.append(edit.entity(f"e{k}"))
            frames = await asyncio.gather(*(scene.render("cam", spp=1) for _ in range(4)))
            task = asyncio.create_task(scene.render("cam", seconds=1000))
            await asyncio.sleep(0.3)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            seen = [f.time async for f in scene.render_sequence("cam", [0, 1], spp=1)]
            return edits, frames, seen

    edits, frames, seen = asyncio.run(work())
    assert [e.name for e in edits] == [f"e{k}" for k in range(10)]
    assert edits[-1].id == daemon.objects["e9"] and len(frames) == 4 and len(seen) == 2
    assert daemon.cancelled.wait(2)


def test_a_render_from_another_thread_does_not_stop_edits(daemon, scene):
    stop = []
    options = {"seconds": 1000, "on_start": stop.append}

    def render():
        with pytest.raises(hg.Cancelled):
            scene.render("cam", **options)

    thread = threading.Thread(target=render)
    thread.start()
    with scene.edit() as edit:
        edit.entity("a")
    while not stop:
        pass
    stop[0]()
    thread.join(5)
    assert not thread.is_alive()
