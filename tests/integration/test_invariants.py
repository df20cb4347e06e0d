"""Invariants of every frame, whatever it shows: deformed, mirrored, sheared, instanced, cut off by
the image, seen in perspective or orthographically. Needs no second opinion but arithmetic."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import extent, pose, rotation
from oracle_motion import Arm, Cloth, Face, Nested, Wall

W, H, T, DT = 128, 80, 0.35, 0.2
PLANES = """
    depth distance position position_camera normal normal_camera geometric_normal tangent instance
    semantic part primitive material object_coordinates nocs coverage
    flow_forward flow_forward_valid flow_forward_visible scene_flow
    flow_backward flow_backward_valid flow_backward_visible
""".split()
CAMERAS = {
    "perspective": hg.Camera(W, H, 120.0, 131.0, 60.3, 42.9),
    "orthographic": hg.Camera(W, H, 17.0, 19.0, 60.3, 42.9, "orthographic"),
}
DEFORMED = {1, 2, 3, 4}


def build(scene: hg.Scene) -> None:
    sheared = pose((-1.2, -1, 0.4), rotation((1, 1, 0), 0.8), (0.5, 0.3, 0.4))
    sheared[:3, 1] += 0.5 * sheared[:3, 0]
    mirrored = pose((1.6, -1.2, 0.4), rotation((0, 0, 1), 0.5), (0.7, -0.5, 0.6))
    copies = np.stack(
        [pose((x, -0.5, 2.4), rotation((x, 1, 0), x), 0.5) for x in (-3.2, 0, 2, 3.5)]
    )
    with scene.edit() as edit:
        for actor in (Cloth(), Face(), Arm(), Nested(), Wall()):
            actor.build(edit)
        ball = edit.mesh("ball", **hg.shapes.sphere(0.8, 24))
        box = edit.mesh("box", **hg.shapes.cube(1.0))
        still = [sheared, mirrored, *copies]
        edit.entity("sheared", mesh=ball, keys={0: sheared, 1: sheared}, label=10, category="ball")
        edit.entity("mirrored", keys={0: mirrored, 1: mirrored}, mesh=box, label=11, category="box")
        lid = pose((0, 0, 0.6), rotation((0, 0, 1), 0.3), (0.8, 0.8, 0.1))
        edit.entity("lid", parent="mirrored", mesh=box, transform=lid)
        for i, copy in enumerate(still[2:]):
            edit.entity(f"copy{i}", mesh=box, keys={0: copy, 1: copy}, label=20 + i, category="box")
        for name, camera in CAMERAS.items():
            keys = {t: hg.look_at((0.3 * t, -7, 1.4), (0, 0, 1.1)) for t in (0, 1)}
            edit.entity(name, camera=camera, keys=keys)


@pytest.fixture(scope="module")
def scene(client):
    with client.create_scene() as made:
        build(made)
        yield made


@pytest.fixture(scope="module", params=list(CAMERAS))
def frame(request, scene):
    labels = ["boxes", "amodal", "amodal_masks"]
    options = {"time": T, "frame_interval": DT, "spp": 1, "labels": labels}
    return scene.render(request.param, planes=PLANES, **options)


def project(frame: hg.Frame, p_camera: np.ndarray) -> np.ndarray:
    z = p_camera[..., 2:] if frame.camera == "perspective" else 1
    return p_camera[..., :2] / z * np.diag(frame.K)[:2] + frame.K[:2, 2]


def transformed(m: np.ndarray, p: np.ndarray) -> np.ndarray:
    return p @ m[:3, :3].T + m[:3, 3]


def test_everything_is_in_sight(frame):
    assert set(np.unique(frame["instance"])) >= {1, 2, 3, 4, 5, 10, 11, 20, 21, 22, 23}
    assert (frame.labels["truncation"] > 0).any() and (frame.labels["occlusion"] > 0).any()
    assert frame["semantic"].max() == 2 and (frame.labels["rigid"] == 0).sum() >= 3


def test_masks_boxes_and_shares(frame):
    labels, instance = frame.labels, frame["instance"]
    assert list(labels["label"]) == sorted(set(labels["label"]))
    assert set(np.unique(instance)) <= {0, *labels["label"].tolist()}
    for row, label in enumerate(labels["label"].tolist()):
        visible, amodal = instance == label, frame.amodal_mask(label)
        assert not (visible & ~amodal).any()
        assert labels["visible"][row] == visible.sum()
        assert labels["inside"][row] == amodal.sum() <= labels["canvas"][row]
        assert list(labels["bbox_visible"][row]) == extent(visible)
        assert list(labels["bbox_amodal"][row]) == extent(amodal)
        x0, y0, x1, y1 = labels["bbox_amodal_canvas"][row]
        inner = labels["bbox_amodal"][row]
        assert not amodal.any() or (
            x0 <= inner[0] and y0 <= inner[1] and x1 >= inner[2] and y1 >= inner[3]
        )
        assert set(np.unique(frame["semantic"][visible])) <= {labels["category"][row]}
        assert (frame["part"][visible] > 0).all()
    for share in ("visibility", "occlusion", "truncation"):
        assert (labels[share] >= 0).all() and (labels[share] <= 1).all(), share
    assert (frame["part"][instance == 0] == 0).all()


def test_depth_and_projection(frame):
    hit = np.isfinite(frame["depth"])
    assert (hit == (frame["primitive"] != 0xFFFFFFFF)).all()
    camera = frame["position_camera"][hit].astype(float)
    np.testing.assert_allclose(frame["depth"][hit], camera[:, 2], rtol=1e-6)
    again = transformed(frame.camera_from_world_cv, frame["position"][hit].astype(float))
    np.testing.assert_allclose(again, camera, atol=1e-5)
    y, x = np.nonzero(hit)
    pixels = np.column_stack([x, y])
    np.testing.assert_allclose(project(frame, camera), pixels, atol=0.01)
    np.testing.assert_allclose(project(frame, again), pixels, atol=0.01)
    origin = camera * 0 if frame.camera == "perspective" else camera * (1, 1, 0)
    np.testing.assert_allclose(
        frame["distance"][hit], np.linalg.norm(camera - origin, axis=1), rtol=1e-5
    )


def test_object_points(frame):
    """world_from_object of the object point is the position, for what keeps its rest shape."""
    labels = frame.labels
    for row, label in enumerate(labels["label"].tolist()):
        pose = labels["world_from_object"][row]
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6)
        assert np.linalg.det(pose[:3, :3]) > 0
        np.testing.assert_allclose(
            labels["camera_from_object_cv"][row], frame.camera_from_world_cv @ pose, atol=1e-5
        )
        seen = frame["instance"] == label
        coordinates = frame["object_coordinates"][seen].astype(float)
        half = labels["box_half_extents"][row].astype(float)
        assert (coordinates > -1e-4).all() and (coordinates < 1 + 1e-4).all()
        inside = (coordinates - 0.5) * 2 * half
        nocs = 0.5 + inside / (2 * np.linalg.norm(half))
        np.testing.assert_allclose(frame["nocs"][seen], nocs, atol=1e-5)
        if label in DEFORMED:
            continue
        points = transformed(pose, labels["box_center"][row] + inside)
        np.testing.assert_allclose(points, frame["position"][seen], atol=2e-4)


def test_directions_are_unit_or_zero(frame):
    hit = np.isfinite(frame["depth"])
    for name in ("normal", "normal_camera", "geometric_normal", "tangent"):
        length = np.linalg.norm(frame[name].astype(float), axis=2)
        assert (length[~hit] == 0).all(), name
        given = hit & (length > 0) if name == "tangent" else hit  # without uvs there is none
        assert given.any()
        np.testing.assert_allclose(length[given], 1, atol=1e-5, err_msg=name)
    turned = frame["normal"].astype(float) @ frame.camera_from_world_cv[:3, :3].T
    np.testing.assert_allclose(frame["normal_camera"], turned, atol=1e-5)
    across = np.abs((frame["tangent"] * frame["normal"]).sum(2))
    assert across[hit].max() < 1e-4
    # The geometric normal faces the viewer.
    towards = frame["position_camera"].astype(float)
    if frame.camera == "orthographic":
        towards = np.zeros_like(towards) + (0, 0, 1)
    facing = frame["geometric_normal"].astype(float) @ frame.camera_from_world_cv[:3, :3].T
    assert ((facing * towards).sum(2)[hit] <= 1e-5).all()


@pytest.mark.parametrize(("name", "other"), [("flow_forward", T + DT), ("flow_backward", T - DT)])
def test_flow_is_reprojection(frame, scene, name, other):
    """By the positions (scene_flow: what moves and what bends), by the poses of what is rigid."""
    there = scene.render(
        frame.camera, planes=["instance"], time=other, labels=["boxes"], progress=False
    )
    hit = np.isfinite(frame["depth"])
    y, x = np.nonzero(hit)
    flow = frame[name][hit].astype(float)
    assert frame[name + "_valid"].all()
    moved = frame["position"].astype(float).copy()
    if name == "flow_forward":
        known = hit
        moved += frame["scene_flow"]
    else:
        known = hit & ~np.isin(frame["instance"], list(DEFORMED))
        for row, label in enumerate(frame.labels["label"].tolist()):
            seen = frame["instance"] == label
            motion = there.labels["world_from_object"][row] @ np.linalg.inv(
                frame.labels["world_from_object"][row]
            )
            moved[seen] = transformed(motion, moved[seen])
    p_camera = transformed(there.camera_from_world_cv, moved[hit])
    expected = project(frame, p_camera) - np.column_stack([x, y])
    np.testing.assert_allclose(flow[known[hit]], expected[known[hit]], atol=0.05)
    assert np.abs(flow).max() > 0.5
    visible = frame[name + "_visible"][hit].astype(bool)
    raster = np.column_stack([x, y]) + flow + 0.5
    inside = (raster >= 0).all(1) & (raster[:, 0] < W) & (raster[:, 1] < H)
    assert not (visible & ~inside).any() and visible.mean() > 0.5
    # What is seen there is the same instance at the pixel where the flow leads, but at outlines.
    seen = visible & inside
    column, line = np.floor(raster[seen]).astype(int).T
    assert (there["instance"][line, column] == frame["instance"][hit][seen]).mean() > 0.95


@pytest.mark.parametrize("cells", [5, 7, 9, 11, 13, 21, 33, 49])
def test_a_wall_whose_edges_lie_on_the_pixels_centres_has_no_holes(client, cells):
    """Rows, columns and diagonals of edges go through centres exactly, but for rounding."""
    pixels, at = 3 * cells, np.arange(cells + 1)  # two pixels a cell
    y, x = np.meshgrid(at, at, indexing="ij")
    corners = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) / cells * 2 - [1, 1, 0]
    first = (y * (cells + 1) + x)[:-1, :-1].reshape(-1, 1)
    triangles = np.concatenate([first + [0, 1, cells + 2], first + [0, cells + 2, cells + 1]])
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("grid", positions=corners, indices=triangles)
            edit.entity("wall", mesh="grid", transform=hg.Pose(scale=2), label=1)
            camera = hg.Camera.from_fov(90, pixels, pixels, degrees=True)
            place = hg.look_at((0, 0, 3), (0, 0, 0), up=(0, 1, 0))
            edit.entity("camera", camera=camera, transform=place)
        frame = scene.render("camera", planes=["instance", "depth"])
        from_middle = (np.arange(pixels) + 0.5 - pixels / 2) * 3 / (pixels / 2)
        covered = np.abs(from_middle) < 1.99
        seen = np.asarray(frame["instance"])[covered][:, covered]
        assert (seen == 1).all()
        assert np.abs(frame["depth"][covered][:, covered] - 3).max() < 1e-5
        picked = scene.pick("camera", np.argwhere(np.outer(covered, covered))[:, ::-1])
        assert (picked.instance == 1).all()
