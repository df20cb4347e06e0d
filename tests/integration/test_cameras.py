"""Every camera model against numpy arithmetic (lenses.py): where points are seen, what planes and
labels say, flow, and where the model sees nothing."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from lenses import HEIGHT, LENSES, WIDTH, direction_at, image_of, lens
from oracle import CV_FROM_GL, look_at_cv, pose, rotation

EYE, TARGET = (0.3, -4.0, 1.2), (0.1, 0.2, 0.4)
CAMERA = look_at_cv(EYE, TARGET)
MOVED = look_at_cv((0.35, -3.9, 1.25), (0.0, 0.2, 0.5))


def world_from(camera_from_world: np.ndarray) -> np.ndarray:
    return np.linalg.inv(camera_from_world) @ CV_FROM_GL


def in_camera(points: np.ndarray, camera_from_world: np.ndarray = CAMERA) -> np.ndarray:
    return points @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]


def pixel_centres(frame: hg.Frame) -> np.ndarray:
    y, x = np.mgrid[: frame.height, : frame.width]
    return np.stack([x, y], -1).astype(float)


@pytest.fixture(scope="module", params=LENSES)
def camera(request) -> hg.Camera:
    return LENSES[request.param]


@pytest.fixture(scope="module")
def room(client):
    """A turned box and balls on all sides of a camera that moves in 0.1 s."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("cube", **hg.shapes.cube(1.0))
            edit.mesh("ball", **hg.shapes.sphere(0.5))
            turned = rotation((1, 2, 3), 0.7)
            edit.entity("box", mesh="cube", transform=pose((0.4, 0.3, 0.2), turned), label=1)
            places = [(-1.2, 0.6, 0.9), (1.6, -5, 1), (-2, -4.5, 2.6), (0.2, -7.5, 0.4)]
            for i, place in enumerate(places):
                edit.entity(f"ball {i}", mesh="ball", transform=pose(place), label=2 + i)
            edit.dome(color=(1, 1, 1))
        yield scene


def placed(scene: hg.Scene, camera: hg.Camera) -> None:
    with scene.edit() as edit:
        keys = {0.0: world_from(CAMERA), 0.1: world_from(MOVED)}
        edit.entity("cam", camera=camera, keys=keys)


def test_a_known_point_is_seen_where_k_says(client, camera):
    """Small balls, each about 3 pixels wide: the centroid of their coverage."""
    random = np.random.default_rng(7)
    grid = np.stack(np.meshgrid(np.linspace(0.06, 0.94, 6), np.linspace(0.08, 0.92, 5)), -1)
    size = (camera.width, camera.height)
    pixels = (grid.reshape(-1, 2) + random.uniform(-0.01, 0.01, (30, 2))) * size
    if camera.projection == "orthographic":
        flat = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        points = np.concatenate([flat, np.full((30, 1), 5.0)], -1)
    else:
        points = 5 * direction_at(camera, pixels)
    seen = image_of(camera, points)
    assert np.abs(seen - pixels).max() < 1e-6
    radius = 1.5 / camera.fx * (1 if camera.projection == "orthographic" else 5)
    world = points @ CAMERA[:3, :3] + np.linalg.inv(CAMERA)[:3, 3]
    with client.create_scene() as scene:
        with scene.edit() as edit:
            ball = edit.mesh("ball", **hg.shapes.sphere(radius))
            edit.instances("ball/s", mesh=ball, transforms=[pose(p) for p in world])
            edit.entity("cam", camera=camera, transform=world_from(CAMERA))
        frame = scene.render("cam", planes=["coverage"], spp=64, filter="box")
        np.testing.assert_array_equal(frame.K, camera.K)
        assert scene["cam"].camera == camera
    coverage = frame["coverage"]
    for x, y in seen:
        x0, y0 = int(round(x)) - 8, int(round(y)) - 8
        rows, columns = np.mgrid[max(y0, 0) : y0 + 17, max(x0, 0) : x0 + 17]
        inside = (rows < frame.height) & (columns < frame.width)
        rows, columns = rows[inside], columns[inside]
        weight = coverage[rows, columns]
        assert weight.sum() > 1.5
        centroid = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
        assert np.linalg.norm(centroid - (x, y)) < 0.1, (centroid, x, y)


def test_planes_and_flow_agree_with_the_formulas(room, camera):
    placed(room, camera)
    planes = ["position", "position_camera", "depth", "distance", "instance"]
    planes += ["flow_forward", "flow_forward_valid"]
    frame = room.render("cam", planes=planes, time=0, frame_interval=0.1, hold=True)
    hit = frame["instance"] > 0
    assert hit.sum() > 500
    position = frame["position"][hit].astype(float)
    p_camera = in_camera(position)
    np.testing.assert_allclose(frame["position_camera"][hit], p_camera, atol=2e-5)
    np.testing.assert_allclose(frame["depth"][hit], p_camera[:, 2], atol=2e-5)
    if camera.projection != "orthographic":
        length = np.linalg.norm(p_camera, axis=1)
        np.testing.assert_allclose(frame["distance"][hit], length, rtol=1e-5)
    pixels = pixel_centres(frame)
    assert np.abs(image_of(camera, p_camera) - pixels[hit]).max() < 0.01
    valid = frame["flow_forward_valid"][hit] > 0
    there = image_of(camera, in_camera(position, MOVED))
    flow = there - pixels[hit]
    assert valid.mean() > 0.9
    assert np.abs(frame["flow_forward"][hit] - flow)[valid].max() < 0.05
    if camera.projection == "orthographic":
        return
    # What is infinitely far turns with the camera alone.
    away = ~hit
    away[::3], away[:, ::2] = False, False
    turn = MOVED[:3, :3] @ CAMERA[:3, :3].T
    directions = direction_at(camera, pixels[away])
    expected = image_of(camera, directions @ turn.T) - pixels[away]
    valid = frame["flow_forward_valid"][away] > 0
    assert valid.mean() > 0.9
    assert np.abs(frame["flow_forward"][away] - expected)[valid].max() < 0.05


def test_labels_bound_what_is_seen(room, camera):
    """Amodal figures of each thing against renders of it alone, on the image and on the canvas."""
    placed(room, camera)
    labels = {"boxes": True, "amodal": True, "amodal_masks": True}
    frame = room.render("cam", planes=["instance"], labels=labels, time=0)
    wider = 0 if camera.projection == "equirectangular" else 1
    w, h = camera.width, camera.height
    around = hg.Camera(
        *(w * (1 + 2 * wider), h * (1 + 2 * wider), camera.fx, camera.fy),
        *(camera.cx + w * wider, camera.cy + h * wider, camera.projection, camera.distortion),
    )
    names = ["box", *(f"ball {i}" for i in range(4))]
    for row, name in enumerate(names):
        label = int(frame.labels["label"][row])
        with room.overlay() as alone:
            for other in names:
                if other != name:
                    alone.entity(other, visible=False)
            alone.entity("around", camera=around, transform=world_from(CAMERA))
        only = (
            room.render("around", planes=["instance"], overlay=alone, time=0)["instance"] == label
        )
        inside = only[h * wider :, w * wider :][:h, :w]
        # The principal points of both cameras round differently: a pixel on the edge may differ.
        assert abs(int(frame.labels["canvas"][row]) - only.sum()) <= 3, name
        assert (frame.amodal_mask(label) != inside).sum() <= 3, name
        assert frame.labels["inside"][row] == frame.amodal_mask(label).sum()
        assert frame.labels["visible"][row] == (frame["instance"] == label).sum()
    corners = frame.labels["corners_camera"].reshape(-1, 3).astype(float)
    image = frame.labels["corners_image"].reshape(-1, 2)
    seen = np.isfinite(image[:, 0])
    assert np.abs(image_of(camera, corners)[seen] - image[seen]).max() < 0.01
    if camera.projection == "equirectangular":
        assert seen.all()


def test_nothing_is_seen_where_the_model_is_not_invertible(room):
    """r (1 - r^2 / 3) ends at r = 1, where it is 2/3."""
    blind = lens("perspective", -1 / 3, 0, 0, 0, scale=0.5)
    placed(room, blind)
    planes = ["beauty", "environment_light", "coverage", "depth", "instance", "flow_forward"]
    planes += ["flow_forward_valid"]
    options = {"time": 0, "frame_interval": 0.1, "hold": True, "spp": 4, "filter": "box"}
    frame = room.render("cam", planes=planes, **options)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    r = np.hypot((x - blind.cx) / blind.fx, (y - blind.cy) / blind.fy)
    outside, inside = r > 2 / 3 + 1.5 / blind.fx, r < 2 / 3 - 1.5 / blind.fx
    assert outside.sum() > 1000 and inside.sum() > 1000
    assert (frame["beauty"][outside] == (0, 0, 0, 1)).all()
    assert (frame["beauty"][inside][:, :3].sum(1) > 0).all()
    for plane in ("environment_light", "coverage", "instance", "flow_forward"):
        assert not frame[plane][outside].any(), plane
    assert not frame["flow_forward_valid"][outside].any()
    assert np.isinf(frame["depth"][outside]).all()
    picked = room.pick("cam", [[0, 0], [blind.cx, blind.cy]])
    assert np.isinf(picked.t[0])


def test_clipping_planes(room):
    plain = LENSES["pinhole"]
    near, far = 3.9, 4.5
    for clip in ({"near": near}, {"far": far}, {"near": near, "far": far}):
        fields = {**plain.__dict__, **clip}
        placed(room, plain)
        whole = room.render("cam", planes=["depth", "instance"], time=0)
        placed(room, hg.Camera(**fields))
        frame = room.render("cam", planes=["depth", "distance", "position_camera"], time=0)
        depth = frame["depth"]
        hit = np.isfinite(depth)
        low, high = clip.get("near", 0), clip.get("far", np.inf)
        assert hit.any() and depth[hit].min() >= low and depth[hit].max() <= high
        kept = (whole["depth"] > low + 1e-4) & (whole["depth"] < high - 1e-4)
        assert kept.sum() > 100 and hit[kept].all()
        np.testing.assert_allclose(depth[kept], whole["depth"][kept], rtol=1e-5)
        length = np.linalg.norm(frame["position_camera"][hit], axis=1)
        np.testing.assert_allclose(frame["distance"][hit], length, rtol=1e-5)
        labels = room.render("cam", planes=["instance"], labels={"amodal": True}, time=0).labels
        np.testing.assert_array_equal(labels["visible"] > 0, labels["inside"] > 0)


def test_disparity_is_for_rectified_rigs(room):
    plain = LENSES["pinhole"]
    right = world_from(CAMERA) @ pose((0.2, 0, 0))

    def ask(camera: hg.Camera, transform: np.ndarray, first: hg.Camera = plain) -> hg.Frame:
        with room.edit() as edit:
            edit.entity("left eye", camera=first, transform=world_from(CAMERA))
            edit.entity("right eye", camera=camera, transform=transform)
        return room.render("left eye", planes=["disparity:right eye", "depth"], time=0)

    frame = ask(plain, right)
    hit = np.isfinite(frame["depth"])
    expected = plain.fx * 0.2 / frame["depth"][hit]
    np.testing.assert_allclose(frame["disparity"][hit], expected, rtol=2e-4)
    k = plain.K
    wide = hg.Camera.from_intrinsics(k * [[1.1], [1], [1]], WIDTH, HEIGHT)
    low = hg.Camera.from_intrinsics(k + [[0, 0, 0], [0, 0, 3], [0, 0, 0]], WIDTH, HEIGHT)
    small = hg.Camera.from_intrinsics(k, WIDTH, HEIGHT - 1)
    for camera, transform, message in [
        (LENSES["barrel"], right, "no distortion"),
        (LENSES["panorama"], right, "no distortion"),
        (wide, right, "fx, fy and cy"),
        (low, right, "fx, fy and cy"),
        (small, right, "same size"),
        (plain, right @ pose((0, 0.01, 0)), "beside"),
        (plain, right @ pose((0, 0, 0.01)), "beside"),
        (plain, right @ pose((0, 0, 0), rotation((0, 1, 0), 0.01)), "same way"),
    ]:
        with pytest.raises(hg.FailedPrecondition, match=message) as raised:
            ask(camera, transform)
        assert "planes.camera" in f"{raised.value.field} {raised.value}"


@pytest.mark.parametrize("scale", [(1, 1, 3), (-1, 1, 1), (0.5, 2, 1)])
def test_a_camera_below_an_uneven_scale_is_rigid(scene, scale):
    with scene.edit() as edit:
        edit.mesh("cube", **hg.shapes.cube(1.0))
        edit.entity("box", mesh="cube", label=1)
        edit.entity("rig", transform=np.diag([*scale, 1.0]))
        eye = hg.look_at((0, -4, 2), (0, 0, 0))
        edit.entity("cam", parent="rig", camera=LENSES["pinhole"], transform=eye)
    frame = scene.render("cam", planes=["depth", "position", "instance"], labels=["boxes"])
    turn = frame.camera_from_world_cv[:3, :3]
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
    forward = np.diag(scale) @ -np.asarray(eye)[:3, 2]  # where its -z points in the world
    assert np.allclose(turn[2], forward / np.linalg.norm(forward), atol=1e-6)
    met = frame["instance"] == 1
    depth = in_camera(frame["position"][met], frame.camera_from_world_cv)[:, 2]
    assert met.any() and np.allclose(frame["depth"][met], depth, rtol=1e-5)


def test_flow_of_a_lens_that_changed(scene):
    near = hg.Camera(64, 48, 50, 50, 31.5, 23.5)
    with scene.edit() as edit:
        edit.mesh("plane", **hg.shapes.plane(40.0))
        edit.entity("floor", mesh="plane")
        edit.entity("cam", camera=near, transform=hg.look_at((0, -4, 2), (0, 0, 0)))
    with scene.edit() as edit:
        edit.advance(0.1)
        edit.entity("cam", camera=hg.Camera(64, 48, 100, 100, 31.5, 23.5))
    frame = scene.render("cam", planes=["flow_backward", "flow_backward_valid", "instance"])
    centre = np.array([31.5, 23.5])
    met = frame["flow_backward_valid"] != 0
    want = (centre - pixel_centres(frame)) / 2  # half as far from the centre
    assert met.any() and np.allclose(frame["flow_backward"][met], want[met], atol=1e-3)


def test_disparity_of_fog_is_of_the_rows_time(scene):
    length, apart, speed = 60.0, 0.2, 2.0
    lens_of_rig = hg.Camera(64, 48, length, length, 31.5, 23.5, rolling=1.0)
    with scene.edit() as edit:
        for name, x in (("left", 0.0), ("right", apart)):
            keys = {0.0: hg.Pose((x, 0, 5.0)), 1.0: hg.Pose((x + speed, 0, 5.0))}
            edit.entity(name, camera=lens_of_rig, keys=keys)
        edit.volume("fog/grid", density=np.full((8, 8, 8), 200.0, "f4"), voxel_size=4.0)
        edit.entity("fog", volume="fog/grid", transform=hg.Pose((-16, -16, -30)))
    frame = scene.render("left", planes=["disparity:right", "depth"], time=0.0)
    disparity, depth = frame["disparity:right"], frame["depth"]
    met = np.isfinite(depth) & (depth > 0)
    assert met.any() and np.allclose(disparity[met], length * apart / depth[met], rtol=1e-3)
