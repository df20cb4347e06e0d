"""Point tracks against numpy: rigid, skinned and deforming motion at any times, and what hides."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from lenses import LENSES, image_of
from oracle import CV_FROM_GL, look_at_cv, pose, rotation

# In any order, and beyond the keys, where things are held.
TIMES = np.array([0.0, 0.13, 0.5, 0.77, 1.0, 1.5, -0.5, 0.2])
CAMERAS = [look_at_cv((0.2, -5, 1.5), (0, 0, 0.5)), look_at_cv((0.9, -4.6, 1.7), (0.1, 0, 0.4))]
AXIS, ANGLES, SCALE = (1, 2, 3), (0.3, 1.5), 0.6
PLACES = np.array([[-0.8, 0, 0.5], [-0.3, 0.2, 0.9]])
TRIANGLE = np.array([[-1, 0, 0], [1, 0, 0], [0, 0, 1.0]])
BEND = np.array([[0, 0, 0], [0, 0.4, 0.2], [0.3, 0, 0.5]])  # of the flag's vertices in a second
REACH = np.array([0, 0.2, 0.6])  # of the hand in a second


def held(t):
    return np.clip(t, 0, 1)


def box_at(t):
    """world_from_box: translation linear, rotation by slerp."""
    u = held(t)
    turn = rotation(AXIS, (1 - u) * ANGLES[0] + u * ANGLES[1])
    return pose((1 - u) * PLACES[0] + u * PLACES[1], turn, SCALE)


def camera_at(t):
    """camera_from_world, likewise."""
    a, b = (np.linalg.inv(c) for c in CAMERAS)
    u = held(t)
    relative = a[:3, :3].T @ b[:3, :3]
    angle = np.arccos((np.trace(relative) - 1) / 2)
    k = (relative - relative.T) / (2 * np.sin(angle))
    turn = np.eye(3) + np.sin(angle * u) * k + (1 - np.cos(angle * u)) * k @ k
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = a[:3, :3] @ turn, (1 - u) * a[:3, 3] + u * b[:3, 3]
    return np.linalg.inv(m)


@pytest.fixture(scope="module")
def world(client):
    """A box that turns, a flag whose vertices have keys, an arm with a hand, and a wall before."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("cube", **hg.shapes.cube(1.0))
            edit.entity("box", mesh="cube", keys={0.0: box_at(0), 1.0: box_at(1)}, label=1)
            flag = np.stack([TRIANGLE, TRIANGLE + BEND])
            edit.mesh("flag/mesh", positions=flag, times=[0, 1], indices=[[0, 1, 2]])
            edit.entity("flag", mesh="flag/mesh", label=2)
            joints, weights = np.zeros((3, 4), "u2"), np.tile([1.0, 0, 0, 0], (3, 1))
            joints[2] = 1
            arm = {"positions": TRIANGLE, "indices": [[0, 1, 2]]}
            edit.mesh("arm/mesh", **arm, joints=joints, weights=weights)
            edit.entity("hip")
            edit.entity("hand", keys={0.0: pose(), 1.0: pose(REACH)})
            skin = (["hip", "hand"], [np.eye(4), np.eye(4)])
            edit.entity("arm", mesh="arm/mesh", skin=skin, label=3)
            keys = {float(t): np.linalg.inv(c) @ CV_FROM_GL for t, c in enumerate(CAMERAS)}
            for name, lens in LENSES.items():
                edit.entity(name, camera=lens, keys=keys)
            wall = pose((0.55, -2.5, 0.2), scale=(0.3, 0.05, 0.9))
            edit.entity("wall", mesh="cube", transform=wall, label=4)
        yield scene


def test_places_at_any_time(world):
    cube = world["cube"]
    primitive, weights = np.array([0, 5, 11]), np.array([[0.2, 0.3], [0.1, 0.6], [0.5, 0.5]])
    full = np.concatenate([1 - weights.sum(1, keepdims=True), weights], 1)
    on_box = (full[:, None] @ cube.positions[cube.indices[primitive]])[:, 0]
    box = world.tracks("pinhole", ("box", primitive, weights), TIMES).position
    flag = world.tracks("pinhole", ("flag", [0, 0, 0], weights), TIMES).position
    arm = world.tracks("pinhole", ("arm", [2, 0]), TIMES).position
    for j, t in enumerate(TIMES):
        m = box_at(t)
        np.testing.assert_allclose(box[:, j], on_box @ m[:3, :3].T + m[:3, 3], atol=2e-6)
        np.testing.assert_allclose(flag[:, j], full @ (TRIANGLE + held(t) * BEND), atol=2e-6)
        np.testing.assert_allclose(arm[0, j], TRIANGLE[2] + held(t) * REACH, atol=2e-6)
        np.testing.assert_allclose(arm[1, j], TRIANGLE[0], atol=2e-6)


@pytest.mark.parametrize("lens", LENSES)
def test_images_at_any_time(world, lens):
    corners = np.arange(8)
    tracks = world.tracks(lens, ("box", corners), TIMES)
    assert tracks.image.shape == (8, len(TIMES), 2)
    assert tracks.visible.shape == tracks.depth.shape == (8, len(TIMES))
    for j, t in enumerate(TIMES):
        m = camera_at(t)
        p = tracks.position[:, j].astype(float) @ m[:3, :3].T + m[:3, 3]
        np.testing.assert_allclose(tracks.depth[:, j], p[:, 2], atol=2e-6)
        image = image_of(LENSES[lens], p)
        np.testing.assert_allclose(tracks.image[:, j], image, atol=2e-3)


def test_what_is_picked_comes_back_to_its_pixel(world):
    y, x = np.mgrid[3:240:7, 5:320:9]
    pixels = np.stack([x.ravel(), y.ravel()], -1).astype(float)
    picked = world.pick("pinhole", pixels)
    hit = np.isfinite(picked.t)
    assert hit.sum() > 50
    points = {name: picked[name][hit] for name in ("entity", "primitive", "barycentric")}
    tracks = world.tracks("pinhole", points, [world.time])
    np.testing.assert_allclose(tracks.image[:, 0], pixels[hit], atol=0.01)
    np.testing.assert_allclose(tracks.position[:, 0], picked.position[hit], atol=1e-5)
    assert tracks.visible.dtype == bool and tracks.visible.all()
    with pytest.raises(hg.InvalidArgument, match="nothing was hit"):
        world.tracks("pinhole", picked, [0.0])


def test_visibility_is_that_of_flow(world):
    """flow_forward_visible says of each pixel's point what its track says at the other end."""
    planes = ["flow_forward", "flow_forward_visible", "instance", "primitive", "barycentric"]
    frame = world.render("pinhole", planes=planes, time=0, frame_interval=0.9, hold=True)
    at = tuple(axis[::7] for axis in np.nonzero(frame["instance"]))
    ids = np.array([0, *(world[name].id for name in ("box", "flag", "arm", "wall"))], "u8")
    points = {
        "entity": ids[frame["instance"][at]],
        "primitive": frame["primitive"][at],
        "barycentric": frame["barycentric"][at],
    }
    tracks = world.tracks("pinhole", points, [0.0, 0.9])
    seen = frame["flow_forward_visible"][at].astype(bool)
    assert 0.02 < seen.mean() < 0.98
    np.testing.assert_array_equal(tracks.visible[:, 1], seen)
    assert tracks.visible[:, 0].all()
    pixels = np.stack(at[::-1], -1)
    flow = frame["flow_forward"][at]
    np.testing.assert_allclose(tracks.image[:, 1] - pixels, flow, atol=0.01)


def test_many_points_and_times_go_in_parts(world):
    sample = world.sample_surface(["box", "flag"], 1200, seed=3)
    times = np.linspace(0, 1, 130)
    tracks = world.tracks("pinhole", sample, times)
    assert tracks.image.shape == (1200, 130, 2)
    one = {name: sample[name][1100:1101] for name in sample}
    alone = world.tracks("pinhole", one, times[100])
    np.testing.assert_array_equal(tracks.position[1100, 100], alone.position[0, 0])
    now = world.tracks("pinhole", sample, world.time)
    np.testing.assert_allclose(now.position[:, 0], sample.position, atol=1e-6)


def test_a_stereo_pair_is_rectified(world):
    lens = LENSES["pinhole"]
    with world.edit() as edit:
        rig = hg.stereo(edit, "rig", camera=lens, baseline=0.2, transform=np.eye(4))
        edit.entity("rig", transform=np.linalg.inv(CAMERAS[0]) @ CV_FROM_GL)
    assert (rig.left.name, rig.right.name) == ("rig/left", "rig/right")
    planes = ["disparity:rig/right", "disparity_visible:rig/right", "depth"]
    frame = world.render("rig/left", planes=planes, time=0)
    hit = np.isfinite(frame["depth"])
    expected = lens.fx * 0.2 / frame["depth"][hit]
    np.testing.assert_allclose(frame["disparity"][hit], expected, rtol=2e-4)
    visible = frame["disparity_visible"][hit]
    assert 0 < visible.mean() < 1
    points = ("box", np.arange(8))
    left, right = (world.tracks(eye, points, 0.0).image[:, 0] for eye in (rig.left, rig.right))
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-3)
    middle = rig.root.world_transform[:3, 3]
    eyes = [eye.world_transform[:3, 3] for eye in (rig.left, rig.right)]
    np.testing.assert_allclose(np.mean(eyes, axis=0), middle, atol=1e-6)
