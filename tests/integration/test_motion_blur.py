"""Blur, rolling shutters and their labels through the client, against arithmetic."""

from __future__ import annotations

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest

ASSETS = Path(__file__).resolve().parents[1] / "assets"
SIZE = 64
FOCAL = 16.0  # pixels a metre


def square(edit: hg.Edits, name: str = "square", **given: object) -> hg.Entity:
    """A white square of one metre in the plane z = 0."""
    edit.mesh(f"{name}/mesh", **hg.shapes.plane(1))
    edit.material(f"{name}/material", base_color=1.0, unlit=True)
    return edit.entity(name, mesh=f"{name}/mesh", material=f"{name}/material", **given)


def camera(edit: hg.Edits, **given: object) -> hg.Entity:
    """An orthographic camera that looks down on it, with +y up in its image."""
    middle = SIZE / 2 - 0.5
    lens = hg.Camera(SIZE, SIZE, FOCAL, FOCAL, middle, middle, "orthographic", **given)
    return edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 5)))


def test_a_moving_square_fades_at_its_ends(scene):
    with scene.edit() as edit:
        keys = hg.moving(hg.Pose(), (0, 1), velocity=(2, 0, 0), time=0.5)
        square(edit, keys=keys)
        camera(edit, shutter=(-0.25, 0.25))
    planes = ["beauty", "beauty_still", "instance"]
    frame = scene.render("cam", planes=planes, time=0.5, spp=1024, filter="box")
    left = SIZE / 2 - FOCAL / 2 + 2 * FOCAL * (np.arange(4000) / 4000 - 0.5) * 0.5
    pixels = np.arange(SIZE)[:, None]
    share = np.minimum(left + FOCAL, pixels + 1) - np.maximum(left, pixels)
    expected = share.clip(0, 1).mean(1)
    np.testing.assert_allclose(frame["beauty"][32, :, 0], expected, atol=0.012)
    sharp = (np.abs(np.arange(SIZE) - SIZE / 2 + 0.5) < FOCAL / 2).astype(float)
    np.testing.assert_array_equal(frame["beauty_still"][32, :, 0], sharp)
    np.testing.assert_array_equal(frame["instance"][32] != 0, sharp != 0)
    assert frame.shutter == (-0.25, 0.25) and frame.rolling == 0 and frame.label_time == 0.5
    again = scene.rerender(frame.manifest)
    assert all(np.array_equal(frame[plane], again[plane]) for plane in planes)


def test_label_time_is_when_labels_are_taken(scene):
    with scene.edit() as edit:
        square(edit, keys=hg.moving(hg.Pose(), (0, 1), velocity=(1, 0, 0)))
        camera(edit, shutter=(0, 1))
    for time in (0.0, 0.5, 1.0):
        frame = scene.render("cam", planes=["position"], label_time=time)
        hit = np.isfinite(frame["position"][..., 0])
        assert hit[32].nonzero()[0].mean() == pytest.approx(SIZE / 2 - 0.5 + FOCAL * time)
        assert frame.labels["world_from_object"][0, 0, 3] == pytest.approx(time)
        assert frame.label_time == time and frame.time == 0


def test_rolling_rows_have_their_own_time(scene):
    velocity, rolling, interval = np.array([1.5, -0.9]), 0.4, 0.1
    with scene.edit() as edit:
        square(edit, keys=hg.moving(hg.Pose(), (-1, 2), velocity=(*velocity, 0), time=0))
        camera(edit, rolling=rolling)
    planes = ["instance", "position", "flow_forward", "flow_forward_valid", "scene_flow"]
    options = {"planes": planes, "frame_interval": interval, "hold": True}
    frame = scene.render("cam", labels=["boxes", "amodal_masks"], **options)
    times = frame.row_times
    assert times[0] == 0 and times[-1] == pytest.approx(rolling)
    y, x = np.mgrid[0:SIZE, 0:SIZE] + 0.5
    at = velocity * times[:, None]
    dx = (x - SIZE / 2) / FOCAL - at[:, :1]
    dy = (SIZE / 2 - y) / FOCAL - at[:, 1:]
    inside = 0.5 - np.maximum(np.abs(dx), np.abs(dy))
    sure = np.abs(inside) > 1e-4
    seen = frame["instance"] != 0
    np.testing.assert_array_equal(seen[sure], (inside > 0)[sure])
    label = int(frame.labels["label"][0])
    np.testing.assert_array_equal(frame.amodal_mask(label), seen)
    pose = frame.labels["world_from_object"][0]
    np.testing.assert_allclose(pose[:2, 3], velocity * rolling / 2, atol=1e-6)
    # The square goes down the image: the next frame sees a point later than an interval after.
    down = -velocity[1] * FOCAL
    delay = interval / (1 - down * rolling / (SIZE - 1))
    flow = frame["flow_forward"][seen]
    assert frame["flow_forward_valid"][seen].all()
    np.testing.assert_allclose(flow[:, 0], velocity[0] * FOCAL * delay, atol=0.02)
    np.testing.assert_allclose(flow[:, 1], down * delay, atol=0.02)
    np.testing.assert_allclose(
        frame["scene_flow"][seen], np.tile([*velocity * interval, 0], (seen.sum(), 1)), atol=1e-5
    )


def test_what_outruns_the_rows_is_seen_by_none(scene):
    with scene.edit() as edit:
        square(edit, keys=hg.moving(hg.Pose((0, 2, 0)), (-1, 1), velocity=(0, -10, 0), time=0))
        camera(edit, rolling=0.4)  # 157 rows a second; the square crosses 160
    frame = scene.render(
        "cam",
        planes=["instance", "flow_forward", "flow_forward_visible"],
        frame_interval=0.05,
        hold=True,
    )
    seen = frame["instance"] != 0
    assert seen.any() and not frame["flow_forward_visible"][seen].any()


def test_a_keypoint_is_where_its_row_has_it(scene):
    with scene.edit() as edit:
        edit.mesh("mesh", **hg.shapes.plane(1), keypoints={"corner": (0.25, 0.25, 0)})
        edit.entity(
            "square",
            mesh="mesh",
            label="auto",
            keys=hg.moving(hg.Pose(), (0, 1), velocity=(1, -1, 0)),
        )
        camera(edit, rolling=0.5)
    labels = scene.render("cam", planes=["depth"], labels=["keypoints"]).labels
    x, y = labels["keypoint_image"][0]
    time = 0.5 * y / (SIZE - 1)
    assert x == pytest.approx(SIZE / 2 - 0.5 + FOCAL * (0.25 + time), abs=0.01)
    assert y == pytest.approx(SIZE / 2 - 0.5 - FOCAL * (0.25 - time), abs=0.01)
    assert labels["keypoint_state"][0] == 3


def test_a_skinned_animation_blurs_into_the_mean_of_its_moments(scene):
    with scene.edit() as edit:
        small = hg.Pose(scale=0.01)
        edit.import_file(ASSETS / "gltf/Fox.glb", name="fox", animation="Run", transform=small)
        edit.dome(color=1.0)
        lens = hg.Camera.from_fov(45, 48, 36, degrees=True, shutter=(0, 0.1))
        edit.entity("cam", camera=lens, transform=hg.look_at((2.2, -0.2, 0.8), (0, -0.2, 0.4)))
    blurred = scene.render("cam", time=0.2, spp=1024)["beauty"]
    moments = [
        scene.render("cam", time=0.2, label_time=t, planes=["beauty_still"], spp=32, seed=i)
        for i, t in enumerate(0.2 + 0.1 * (np.arange(32) + 0.5) / 32)
    ]
    mean = np.mean([moment["beauty_still"] for moment in moments], axis=0)
    moves = np.abs(moments[0]["beauty_still"] - moments[-1]["beauty_still"]).mean()
    assert np.abs(blurred - mean).mean() < 0.1 * moves
    assert blurred.mean() == pytest.approx(mean.mean(), rel=2e-3)


def test_static_entities_that_move_leave_their_group(scene):
    with scene.edit() as edit:
        edit.mesh("mesh", **hg.shapes.cube(0.3))
        edit.material("white", base_color=0.8)
        edit.dome(color=1.0)
        for i in range(49):
            at = (0.5 * (i % 7) - 1.5, 0.5 * (i // 7) - 1.5, 0)
            keys = {"keys": hg.moving(hg.Pose(at), (0, 1), velocity=(0, 0.3, 0))} if i < 3 else {}
            given = keys or {"transform": hg.Pose(at)}
            edit.entity(f"cube/{i}", mesh="mesh", material="white", static=True, **given)
        camera(edit, shutter=(0, 1))
    grouped = scene.render("cam", planes=["beauty", "coverage"], spp=64)
    with scene.edit() as edit:
        for i in range(49):
            edit.update(f"cube/{i}", static=False)
    apart = scene.render("cam", planes=["beauty", "coverage"], spp=64)
    np.testing.assert_allclose(grouped["coverage"], apart["coverage"], atol=0.02)
    np.testing.assert_allclose(grouped["beauty"].mean(), apart["beauty"].mean(), rtol=2e-3)


def test_simulators_blur_over_their_last_step(scene):
    with scene.edit() as edit:
        square(edit, transform=hg.Pose((-0.5, 0, 0)))
        camera(edit, shutter=(-0.5, 0))
    with scene.edit() as edit:
        edit.advance(0.5)
        edit.update("square", transform=hg.Pose((0.5, 0, 0)))
    blurred = scene.render("cam", spp=256, filter="box")["beauty"][32, :, 0]
    assert blurred[SIZE // 2] == pytest.approx(1 - 0.5 / FOCAL, abs=0.02)
    np.testing.assert_allclose(blurred, blurred[::-1], atol=0.02)
    assert 0.4 < blurred[SIZE // 2 - 12 : SIZE // 2 - 4].mean() < 0.6


def test_a_second_camera_needs_the_same_rows(scene):
    with scene.edit() as edit:
        square(edit)
        camera(edit, rolling=0.1)
        edit.entity("right", camera=hg.Camera.orthographic(FOCAL, SIZE, SIZE))
    with pytest.raises(hg.FailedPrecondition, match="rolling"):
        scene.render("cam", planes=["disparity:right"])
