"""Pose of the camera in the other frame of a flow, from the flow itself. Used by
frame_planes.py."""

from __future__ import annotations

import numpy as np

from ..._wire.arrays import NdArray
from .lens import Lens

_ROUNDS = 12


def flow_error(lens: Lens, pose: NdArray, points: NdArray, pixels: NdArray) -> NdArray:
    """(N,) px between the stated places (N, 2) in the image of points (N, 3) of the world and those
    by the camera that fits most of them.

    Gauss-Newton from pose, (4, 4) camera_from_world, with Huber's weights (1964), which make few
    wrong ones count little.
    """
    turn, place = pose[:3, :3].copy(), pose[:3, 3].copy()
    chosen = _sample(len(points))
    for _ in range(_ROUNDS):
        error, jacobian = _linearised(lens, points[chosen] @ turn.T + place, pixels[chosen])
        length = np.linalg.norm(error, axis=1)
        bound = max(0.01, 1.5 * float(np.median(length)))
        weight = np.repeat(np.minimum(1, bound / np.maximum(length, 1e-12)), 2)
        rows = jacobian.reshape(-1, 6)
        normal = (rows * weight[:, None]).T @ rows + 1e-9 * np.eye(6)
        step = np.linalg.solve(normal, (rows * weight[:, None]).T @ error.ravel())
        turn, place = _exp(step[:3]) @ turn, _exp(step[:3]) @ place + step[3:]
        if np.abs(step).max() < 1e-10:
            break
    seen = points @ turn.T + place
    visible = lens.sees(seen, 0.01)  # behind it there is no image
    error = lens.project(np.where(visible[:, None], seen, 1.0)) - pixels
    return np.asarray(np.where(visible, np.linalg.norm(error, axis=1), 0.0))


def _sample(count: int) -> NdArray:
    """Rows of at most 4096 points, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, 4096)).astype(int))


def _linearised(lens: Lens, seen: NdArray, pixels: NdArray) -> tuple[NdArray, NdArray]:
    """Residual (N, 2), and its Jacobian (N, 2, 6) by a turn and a step of the camera's frame."""
    visible = lens.sees(seen, 1e-3)
    seen = np.where(visible[:, None], seen, (0, 0, 1))
    error = np.where(visible[:, None], pixels - lens.project(seen), 0.0)
    by_point = np.zeros((len(seen), 2, 3))
    step = 1e-5 * np.linalg.norm(seen, axis=1, keepdims=True)
    for axis, way in enumerate(np.eye(3)):
        ahead, behind = lens.project(seen + step * way), lens.project(seen - step * way)
        by_point[:, :, axis] = visible[:, None] * (ahead - behind) / (2 * step)
    cross = np.zeros((len(seen), 3, 3))  # of a turn w: w x seen
    cross[:, 0, 1], cross[:, 0, 2] = seen[:, 2], -seen[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = -seen[:, 2], seen[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = seen[:, 1], -seen[:, 0]
    return error, np.concatenate([by_point @ cross, by_point], axis=2)


def _exp(turn: NdArray) -> NdArray:
    """The rotation by a vector (Rodrigues 1840)."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
