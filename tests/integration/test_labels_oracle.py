"""Every label column against numpy arithmetic on the same scene (oracle.py)."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import extent, pixel_rays, trace
from oracle_world import HEIGHT, WIDTH, K, Truth, World, project


@pytest.fixture(scope="module")
def world(client: hg.Client) -> World:
    return World(client)


def rows(world: World) -> dict[int, int]:
    return {int(label): i for i, label in enumerate(world.frames[1].labels["label"])}


def test_label_rows(world):
    labels = world.frames[1].labels
    assert list(labels["label"]) == [3, 5, 7]
    frame = world.frames[1]
    assert [frame.categories[int(c)] for c in labels["category"]] == ["ball", "crate", "ground"]
    camera = world.camera_from_world(1)
    for label, root in ((7, 0), (3, 1), (5, 2)):
        row = rows(world)[label]
        m = world.states[1][root].world
        scale = np.linalg.norm(m[:3, :3], axis=0)
        rigid = m.copy()
        rigid[:3, :3] /= scale
        np.testing.assert_allclose(labels["world_from_object"][row], rigid, atol=1e-5)
        np.testing.assert_allclose(labels["camera_from_object_cv"][row], camera @ rigid, atol=1e-5)
        np.testing.assert_allclose(labels["scale"][row], scale, atol=1e-5)
        assert labels["rigid"][row]


def test_boxes_3d(world):
    labels = world.frames[1].labels
    row = rows(world)[5]
    crate, lid = world.states[1][2], world.states[1][3]
    m = labels["world_from_object"][row].astype(float)
    local = [(t.world_positions() - m[:3, 3]) @ m[:3, :3] for t in (crate, lid)]
    points = np.concatenate(local)
    low, high = points.min(0), points.max(0)
    np.testing.assert_allclose(labels["box_center"][row], (low + high) / 2, atol=1e-5)
    np.testing.assert_allclose(labels["box_half_extents"][row], (high - low) / 2, atol=1e-5)
    corners = labels["corners_camera"][row].astype(float)
    np.testing.assert_allclose(labels["corners_image"][row], project(np.eye(4), corners), atol=0.01)
    back = np.linalg.inv(labels["camera_from_object_cv"][row])
    local_corners = corners @ back[:3, :3].T + back[:3, 3]
    np.testing.assert_allclose(np.sort(local_corners, 0)[[0, -1]], [low, high], atol=1e-4)


def test_masks_boxes_and_counts(world):
    frame = world.frames[1]
    labels = frame.labels
    truth = Truth(world, 1)
    masks = [frame.amodal_mask(int(label)) for label in labels["label"]]
    total = 0
    for label, members in ((7, [0]), (3, [1]), (5, [2, 3])):
        row = rows(world)[label]
        visible = frame["instance"] == label
        total += visible.sum()
        assert labels["visible"][row] == visible.sum()
        assert list(labels["bbox_visible"][row]) == extent(visible)
        alone = trace([truth.things[i] for i in members], truth.origin, truth.directions)
        expected = (alone.thing >= 0).reshape(HEIGHT, WIDTH)
        sure = (alone.margin.reshape(HEIGHT, WIDTH) > 2e-3) | ~expected & ~masks[row]
        assert (masks[row] == expected)[sure].all()
        assert (visible <= masks[row]).all()
        assert labels["inside"][row] == masks[row].sum()
        assert list(labels["bbox_amodal"][row]) == extent(masks[row])

        wide = K + np.array([[0, 0, WIDTH], [0, 0, HEIGHT], [0, 0, 0]])
        rays = pixel_rays(wide, 3 * WIDTH, 3 * HEIGHT).reshape(-1, 3) @ truth.camera[:3, :3]
        canvas = trace([truth.things[i] for i in members], truth.origin, rays).thing >= 0
        assert abs(int(labels["canvas"][row]) - canvas.sum()) <= 3
        box = np.array(extent(canvas.reshape(3 * HEIGHT, 3 * WIDTH))) - [
            WIDTH,
            HEIGHT,
            WIDTH,
            HEIGHT,
        ]
        assert np.abs(labels["bbox_amodal_canvas"][row] - box).max() <= 1
        assert labels["visibility"][row] == pytest.approx(
            labels["visible"][row] / labels["canvas"][row]
        )
        assert labels["occlusion"][row] == pytest.approx(
            1 - labels["visible"][row] / labels["inside"][row]
        )
        assert labels["truncation"][row] == pytest.approx(
            1 - labels["inside"][row] / labels["canvas"][row]
        )
    assert total == (frame["instance"] != 0).sum()
