"""Pose of a transform at one instant, and its mathematics; many at once for render()."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .glm.quaternions import of_rotation, quat, rotation_of
from .glm.vectors import Numbers, floats, vec3

if TYPE_CHECKING:
    from .transforms import transform

_ONES = (1.0, 1.0, 1.0)
STILL: tuple[float, ...] = (0.0, 0.0, 0.0)
NO_TURN = quat()
_IDENTITY = np.eye(4)
_THIN = 1e-9
_THINNEST = 1e-5  # of the largest extent


@dataclass
class Placement:
    """matrix * translation * rotation * scale. None, of the previous frame: by the velocity."""

    scale: tuple[float, ...] | None = _ONES
    rotation: quat | None = field(default_factory=lambda: NO_TURN)
    position: tuple[float, ...] | None = STILL
    matrix: Any = field(default_factory=lambda: _IDENTITY)

    def is_set(self) -> bool:
        """True if a part is not None."""
        parts = (self.position, self.rotation, self.scale, self.matrix)
        return any(part is not None for part in parts)

    def rows(self) -> Any:
        """(4, 4) float64, parent from local."""
        out = np.eye(4)
        out[:3, :3] = rotation_of(self.rotation or NO_TURN) * self.scale
        out[:3, 3] = self.position
        return out if self.matrix is _IDENTITY else self.matrix @ out

    def translation(self) -> Any:
        out = np.eye(4)
        out[:3, 3] = self.position
        return out

    def scaling(self) -> Any:
        return np.diag([*(self.scale or _ONES), 1.0])

    def turning(self) -> Any:
        out = np.eye(4)
        out[:3, :3] = rotation_of(self.rotation or NO_TURN)
        return out


FOLLOWS = Placement(None, None, None, None)  # the previous pose of all that have none


def look(eye: Any, at: Any, up: Any) -> Any:
    """(3, 3) rotation whose -Z points from eye to at; `up` may be parallel to it."""
    back = eye - at
    length = np.linalg.norm(back)
    if length == 0:
        raise RuntimeError("look_at: eye and at are the same point")
    back = back / length
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-6 * max(1.0, float(np.linalg.norm(up))):
        right = np.cross((0.0, 1.0, 0.0) if abs(back[1]) < 0.9 else (1.0, 0.0, 0.0), back)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)


def decompose(matrix: Any) -> tuple[tuple[float, ...], quat, tuple[float, ...]] | None:
    """(scale, rotation, position); a mirrored one has three negative scales. None: it is none."""
    linear = matrix[:3, :3]
    if not np.isfinite(matrix).all() or abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-6:
        return None
    scale = np.linalg.norm(linear, axis=0)
    if scale.min() < 1e-12:
        return None
    axes = linear / scale
    if abs(axes.T @ axes - np.eye(3)).max() > 1e-3:
        return None
    if np.linalg.det(axes) < 0:
        axes, scale = -axes, -scale
    return tuple(scale.tolist()), of_rotation(axes), tuple(matrix[:3, 3].tolist())


def powered(q: quat, exponent: float) -> quat:
    """The rotation by `exponent` times the angle."""
    length = math.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)
    sine = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z)
    if sine < 1e-12 * max(length, 1e-300):
        return quat()
    half = math.atan2(sine, q.w) * exponent
    s = math.sin(half) / sine
    return quat(math.cos(half), q.x * s, q.y * s, q.z * s)


def vector_of_world(
    owner: transform, value: Numbers, kind: str, previous: bool, inverse: bool = False
) -> Any:
    """A point, vector or direction from local to world, or back."""
    matrix = owner._world(previous)
    if kind == "direction":
        matrix[:3, :3] = nearest_rotation(matrix[:3, :3])
    if inverse:
        matrix = inverted(matrix)
    moved = matrix[:3, :3] @ np.array(floats(value, 3, kind))
    if kind == "point":
        moved = moved + matrix[:3, 3]
    return vec3(*moved.tolist())


def inverted(matrix: Any) -> Any:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        raise RuntimeError("this transform has no inverse: a scale is 0") from None


def nearest_rotation(linear: Any) -> Any:
    """The rotation (or mirrored one) of a polar decomposition; Higham 1986."""
    u, _, v = np.linalg.svd(linear)
    return u @ v


def local_matrices(transforms: Sequence[transform], previous: bool) -> Any:
    """(N, 4, 4) float64, parent from local."""
    placed = [t._at(previous) for t in transforms]
    out = np.zeros((len(placed), 4, 4))
    if not placed:
        return out
    turns = [p.rotation or NO_TURN for p in placed]
    q = np.array([(turn.x, turn.y, turn.z, turn.w) for turn in turns])
    x, y, z, w = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-30)).T
    out[:, 0, 0], out[:, 0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
    out[:, 0, 2], out[:, 1, 0] = 2 * (x * z + w * y), 2 * (x * y + w * z)
    out[:, 1, 1], out[:, 1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[:, 2, 0], out[:, 2, 1] = 2 * (x * z - w * y), 2 * (y * z + w * x)
    out[:, 2, 2] = 1 - 2 * (x * x + y * y)
    out[:, :3, :3] *= np.array([p.scale for p in placed])[:, None, :]
    out[:, :3, 3] = np.array([p.position for p in placed])
    out[:, 3, 3] = 1
    for i, placement in enumerate(placed):
        if placement.matrix is not _IDENTITY:
            out[i] = placement.matrix @ out[i]
    return out


def world_matrices(transforms: Sequence[transform], previous: bool) -> Any:
    """(N, 4, 4) float64, world from local."""
    out = local_matrices(transforms, previous)
    parents: dict[transform, Any] = {}
    for i, child in enumerate(transforms):
        parent = child._parent
        if parent is not None:
            if parent not in parents:
                parents[parent] = parent._world(previous)
            out[i] = parents[parent] @ out[i]
    return out


def solid(matrices: Any) -> Any:
    """Thickens matrices (N, 4, 4), in place: a scale of 0 becomes one too small to be seen, as the
    daemon refuses flat ones."""
    linear = matrices[:, :3, :3]
    lengths = np.linalg.norm(linear, axis=1)
    volumes = np.abs(np.linalg.det(linear))
    thin = (lengths.min(axis=1) < _THIN) | (volumes < _THIN * lengths.prod(axis=1))
    for i in np.flatnonzero(thin):
        u, extents, v = np.linalg.svd(linear[i])
        linear[i] = (u * np.maximum(extents, max(_THIN, _THINNEST * extents[0]))) @ v
    return matrices


def shown_pose(owner: transform, previous: bool) -> Any:
    """(4, 4) float64, world from local, as the daemon gets it."""
    return solid(owner._world(previous)[None])[0]


def moves(owner: transform) -> bool:
    """True if the pose at the previous frame may differ from the current one."""
    above: transform | None = owner
    while above is not None:
        if above._before is not FOLLOWS and above._before.is_set():
            return True
        if above._linear is not STILL and any(above._linear):
            return True
        if above._scaling is not STILL and any(above._scaling):
            return True
        if above._angular is not NO_TURN and tuple(above._angular)[:3] != STILL:
            return True
        above = above._parent
    return False
