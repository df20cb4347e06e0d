"""Motion vectors: place of a pixel's surface at the previous frame, and now."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .entities import entity
from .glm.quaternions import of_rotation, rotation_of
from .glm.rotations import slerp
from .placement import moves, nearest_rotation, shown_pose
from .view import View

_BACKGROUND = 1e4  # units to infinitely far points


def motion_vectors(frame: Any, view: View, time: float, directions: Any) -> Any:
    """(H, W, 3): half of the difference of normalised device coordinates, previous frame to now: x
    in widths, y in heights upwards, z of depth."""
    before, now = (np.array(pose) for pose in view.poses)
    eye = between(before, now, time)[:3, 3]
    points = frame["position"].astype(float)
    background = ~np.isfinite(points).all(axis=-1)
    points[background] = (eye + _BACKGROUND * directions)[background]
    old, new = points.copy(), points
    shown: dict[int, Any] = {e._id + 1: e for e in entity.get_renderable_entities()}
    for label, pixels in _pixels_of(frame["instance"]):
        found = shown.get(label)
        if found is not None and moves(found._transform):
            first, last = (shown_pose(found._transform, previous) for previous in (True, False))
            back = np.linalg.inv(between(first, last, time))
            for target, pose in ((old, first), (new, last)):
                step, flat = pose @ back, target.reshape(-1, 3)
                flat[pixels] = flat[pixels] @ step[:3, :3].T + step[:3, 3]
    projection = projection_of(view)
    return 0.5 * (_ndc(new, projection, now) - _ndc(old, projection, before))


def _pixels_of(labels: Any) -> Iterator[tuple[int, Any]]:
    """(label, numbers of its pixels) of each label in a picture."""
    flat = labels.reshape(-1)
    order = np.argsort(flat, kind="stable")
    found, starts = np.unique(flat[order], return_index=True)
    yield from zip(found.tolist(), np.split(order, starts[1:]))


def projection_of(view: View) -> Any:
    """(4, 4): the camera's, with its depth from 1 to 1000."""
    c = view.camera
    near, far = 1.0, 1000.0
    return np.array(
        [
            [2 * c.fx / c.width, 0, 1 - 2 * (c.cx + 0.5) / c.width, 0],
            [0, 2 * c.fy / c.height, 2 * (c.cy + 0.5) / c.height - 1, 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )


def _ndc(points: Any, projection: Any, pose: Any) -> Any:
    matrix = projection @ np.linalg.inv(pose)
    clip = points @ matrix[:, :3].T + matrix[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        return clip[..., :3] / clip[..., 3:]


def between(before: Any, now: Any, time: float) -> Any:
    """(4, 4) at a time in [0, 1], as the daemon has it: position and stretch linearly, rotation
    along the shorter arc (Shoemake and Duff 1992)."""
    if time in (0.0, 1.0):
        return now if time else before
    (p0, q0, s0), (p1, q1, s1) = _parts(before), _parts(now)
    out = np.eye(4)
    turn = rotation_of(slerp(q0, q1, time))
    out[:3, :3] = turn @ (s0 * (1 - time) + s1 * time)
    out[:3, 3] = p0 * (1 - time) + p1 * time
    return out


def _parts(matrix: Any) -> tuple[Any, Any, Any]:
    """(position, rotation, symmetric stretch)."""
    turn = nearest_rotation(matrix[:3, :3])
    if np.linalg.det(turn) < 0:
        turn = -turn
    return matrix[:3, 3], of_rotation(turn), turn.T @ matrix[:3, :3]
