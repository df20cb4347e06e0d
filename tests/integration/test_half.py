"""Planes as half floats: the float32 ones rounded to the nearest, however they travel."""

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire import shared

PLANES = ["beauty", "depth", "position", "instance"]
HALF = ["beauty", "depth", "position"]


def build(client):
    """A ball in front of nothing, lit by a lamp too bright for a half, with background in view."""
    scene = client.create_scene()
    with scene.edit() as edit:
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
        lamp = edit.material("lamp", emission=(1e6, 1.0, 1e-7))
        edit.entity("ball", mesh=mesh, material=lamp, label="auto")
        lens = hg.Camera.from_fov(50, 160, 120, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
    return scene


def rounded(plane):
    return plane.clip(-65504, 65504, where=np.isfinite(plane), out=plane.copy()).astype("f2")


def check(frame, whole):
    for name in HALF:
        assert frame[name].dtype == np.float16 and not frame[name].flags.writeable
        assert np.array_equal(frame[name], rounded(whole[name]), equal_nan=True), name
    assert np.array_equal(frame["instance"], whole["instance"])


@pytest.fixture(params=["in shared memory", "in chunks", "in odd chunks"])
def stage(request, monkeypatch):
    if request.param != "in shared memory":
        monkeypatch.setattr(shared, "CAPABILITY", "none of these")
    flags = ["--limit", "chunk_bytes=4097"] if "odd" in request.param else []
    with hg.connect(arguments=flags) as client:
        yield build(client)


def test_halves_are_the_floats_rounded(stage):
    whole = stage.render("cam", planes=PLANES, spp=2)
    assert np.isinf(whole["depth"]).any() and np.isnan(whole["position"]).any()
    assert whole["beauty"].max() > 65504
    frame = stage.render("cam", planes=PLANES, half=HALF, spp=2)
    check(frame, whole)
    check(stage.rerender(frame.manifest), whole)
    job = hg.Job("cam", planes=PLANES, half=HALF, spp=2)
    check(next(iter(stage.render_batch([job]))).frames[0], whole)
    with stage.stream("cam", planes=PLANES, half=HALF, spp=2, policy="lossless") as live:
        check(next(live), whole)


def test_half_frames_are_shown_and_kept_as_others_are(client, tmp_path):
    with build(client) as scene:
        with scene.edit() as edit:
            edit.material("lamp", emission=0.4)
        whole = scene.render("cam", planes=PLANES, spp=2)
        frame = scene.render("cam", planes=PLANES, half=HALF, spp=2)
    for exposure in (0.0, "auto"):
        images = [each.image(exposure=exposure).astype(int) for each in (whole, frame)]
        assert abs(images[0] - images[1]).max() <= 1
    for plane in PLANES:
        assert frame.picture(plane).shape == whole.picture(plane).shape
    for name in ("out.npz", "out.exr", "out.png"):
        frame.save(tmp_path / name)
    assert np.load(tmp_path / "out.npz")["depth"].dtype == np.float16


def test_only_floats_that_are_asked_for_can_be_halves(client):
    with build(client) as scene:
        with pytest.raises(hg.InvalidArgument, match="is for planes of f32") as refused:
            scene.render("cam", planes=PLANES, half=["instance"], spp=1)
        assert refused.value.field == "planes[3].half"
        with pytest.raises(hg.InvalidArgument, match="'normal' is not among planes"):
            scene.render("cam", planes=PLANES, half=["normal"], spp=1)
