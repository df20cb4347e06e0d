"""A banner with two joints and a morph target, and what a camera sees of it at any time, by
arithmetic. Used by test_imported_motion.py and test_moving_collada.py."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import extent, pixel_rays, pose, rotation, trace
from oracle_motion import HEIGHT, WIDTH, K, Shape, grid, project

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
TURN = 1.2  # radians that the upper joint turns about +X in a second
ROOT = pose((0.1, 0.2, 0.8), rotation((0, 0, 1), 0.4), 1.5)
CAMERA = hg.look_at((0, -5, 1.5), (0, 0, 1))


class Banner:
    """A sheet in the plane z = 0, +Y up, two joints in it, and one morph target."""

    def __init__(self) -> None:
        points, self.faces = grid(4)
        self.points = np.column_stack([points[:, 0], points[:, 2], points[:, 1]])  # +Y up
        upper = np.clip(0.5 + self.points[:, 1], 0, 1)
        self.weights = np.column_stack([1 - upper, upper, 0 * upper, 0 * upper])
        self.target = np.column_stack([0.4 * self.points[:, 0], 0 * upper, 0 * upper])

    def shape(self, root: np.ndarray, turn: float, weight: float) -> Shape:
        """In the world: joints turn, then the model stands up and goes where its root is."""
        lower = pose((0.2, 0, 0))
        joints = np.stack([lower, lower @ pose(r=rotation((1, 0, 0), turn))])
        points = self.points + weight * self.target
        blend = np.tensordot(self.weights[:, :2], joints, 1)
        points = np.einsum("vij,vj->vi", blend[:, :3, :3], points) + blend[:, :3, 3]
        return Shape(points, self.faces, root @ Z_UP, label=1, rest=self.points)


def build(scene, model, **options):
    with scene.edit() as edit:
        asset = edit.import_file(model.path, transform=ROOT, **options)
        camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
        edit.entity("cam", camera=camera, keys={0: CAMERA, 1: CAMERA})
    return asset


def check(frame, shape, moved=None) -> None:
    camera = np.diag([1.0, -1, -1, 1]) @ np.linalg.inv(CAMERA)
    directions = pixel_rays(K, WIDTH, HEIGHT).reshape(-1, 3) @ camera[:3, :3]
    eye = -camera[:3, :3].T @ camera[:3, 3]
    hits = trace([shape], eye, directions)
    sure = (hits.thing >= 0) & (hits.margin > 4e-3)
    assert sure.sum() > 400
    flat = {name: np.asarray(frame[name], float).reshape(len(sure), -1) for name in frame}
    np.testing.assert_allclose(flat["depth"][sure, 0], hits.t[sure], rtol=5e-5)
    position = eye + hits.t[:, None] * directions
    np.testing.assert_allclose(flat["position"][sure], position[sure], atol=3e-4)
    assert list(frame.labels["bbox_visible"][0]) == extent(frame["instance"] == 1)
    assert (frame["instance"] == 1).sum() == pytest.approx((hits.thing >= 0).sum(), abs=3)
    if moved is None:
        return
    corner = moved.world_positions()[shape.triangles[hits.triangle[sure]]]
    u, v = hits.u[sure, None], hits.v[sure, None]
    there = corner[:, 0] * (1 - u - v) + corner[:, 1] * u + corner[:, 2] * v
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    expected = project(camera, there) - pixels[sure]
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(flat["flow_forward"][sure], expected, atol=0.02)
    np.testing.assert_allclose(flat["scene_flow"][sure], there - position[sure], atol=3e-4)
