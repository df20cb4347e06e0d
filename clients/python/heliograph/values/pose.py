"""Poses: where things are, which way they look and how they move. Used by edits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._wire.arrays import NdArray, checked
from .._wire.lent import GpuArray, is_on_gpu
from .._wire.tensors import on_host
from ..errors import InvalidArgument


@dataclass(frozen=True, eq=False)
class Pose:
    """A position, one rotation and a scale.

    position: (3,) metres. Rotation, at most one of: `wxyz` or `xyzw` (a quaternion in the order its
    name says), `euler` ((3,) radians about the fixed x, then y, then z axis), `matrix3` ((3, 3)).
    scale: a number or (3,), applied first, along the local axes.
    """

    position: Any = (0.0, 0.0, 0.0)
    wxyz: Any = None
    xyzw: Any = None
    euler: Any = None
    matrix3: Any = None
    scale: Any = 1.0

    @property
    def matrix(self) -> NdArray:
        """(4, 4) float64, parent_from_local."""
        out = np.eye(4)
        out[:3, 3] = checked(self.position, "position", "f8", (3,))
        scale = np.asarray(self.scale, dtype="f8")
        if scale.shape not in ((), (3,)) or not np.isfinite(scale).all() or (scale == 0).any():
            raise InvalidArgument("scale: needs a number or (3,), not 0", field="scale")
        out[:3, :3] = self._rotation() * scale
        return out

    def _rotation(self) -> NdArray:
        given = [n for n in ("wxyz", "xyzw", "euler", "matrix3") if getattr(self, n) is not None]
        if len(given) > 1:
            raise InvalidArgument(f"give one rotation, not {' and '.join(given)}", field=given[1])
        if not given:
            return np.eye(3)
        if given[0] == "matrix3":
            return checked(self.matrix3, "matrix3", "f8", (3, 3))
        if given[0] == "euler":
            return rotation_of_euler(checked(self.euler, "euler", "f8", (3,)))
        quaternion = checked(getattr(self, given[0]), given[0], "f8", (4,))
        return rotation_of_wxyz(np.roll(quaternion, 1) if given[0] == "xyzw" else quaternion)


def rotation_of_wxyz(quaternion: NdArray) -> NdArray:
    """(3, 3) rotation of a quaternion (w, x, y, z), which is normalised."""
    norm = float(np.linalg.norm(quaternion))
    if norm < 1e-9:
        raise InvalidArgument("a quaternion of length 0 is no rotation", field="wxyz")
    w, x, y, z = quaternion / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_of_euler(angles: NdArray) -> NdArray:
    """(3, 3): about the fixed x, then y, then z axis; radians."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def look_at(eye: Any, at: Any, up: Any = (0.0, 0.0, 1.0)) -> NdArray:
    """(4, 4) float64 pose of a camera at `eye` that looks at `at`; `up` is up in its image."""
    eye, at, up = (checked(v, n, "f8", (3,)) for v, n in ((eye, "eye"), (at, "at"), (up, "up")))
    forward = at - eye
    length = float(np.linalg.norm(forward))
    if length == 0:
        raise InvalidArgument("look_at: eye and at are the same point", field="at")
    forward /= length
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(up))):
        right = np.cross(forward, (0.0, 1.0, 0.0) if abs(forward[1]) < 0.9 else (1.0, 0.0, 0.0))
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2] = right, np.cross(right, forward), -forward
    out[:3, 3] = eye
    return out


def moving(
    pose: Any,
    times: Sequence[float],
    *,
    velocity: Any = (0.0, 0.0, 0.0),
    angular_velocity: Any = (0.0, 0.0, 0.0),
    time: float | None = None,
) -> dict[float, NdArray]:
    """Keys {time: (4, 4)} of uniform motion over times[0] .. times[-1], seconds, for `keys=`.

    pose: a 4x4 or Pose, at `time`, by default times[0]. velocity: (3,) metres per second in the
    parent's frame. angular_velocity: (3,) radians per second about that axis of the parent's frame,
    through the pose's own position. Keys come at `times`, and in between where the rotation exceeds
    60 degrees.
    """
    at = checked(list(times), "times", "f8", (None,))
    if len(at) < 2 or (np.diff(at) <= 0).any():
        raise InvalidArgument("times: needs at least two, increasing", field="times")
    start = np.asarray(matrix_of(pose, "pose"), dtype="f8")
    linear = checked(velocity, "velocity", "f8", (3,))
    angular = checked(angular_velocity, "angular_velocity", "f8", (3,))
    speed = float(np.linalg.norm(angular))
    origin = float(at[0]) if time is None else float(time)
    out = {}
    for begin, end in zip(at[:-1], at[1:]):
        parts = max(1, math.ceil((end - begin) * speed / (math.pi / 3) - 1e-9))
        for t in np.linspace(begin, end, parts + 1):
            elapsed = float(t) - origin
            matrix = start.copy()
            matrix[:3, :3] = _rotation_about(angular, speed * elapsed) @ start[:3, :3]
            matrix[:3, 3] += linear * elapsed
            out[float(t)] = matrix
    return out


def _rotation_about(axis: NdArray, angle: float) -> NdArray:
    """(3, 3) rotation by radians about an axis of any length; Rodrigues' formula."""
    length = float(np.linalg.norm(axis))
    if length == 0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)


def matrix_of(pose: Any, field: str = "transform") -> NdArray:
    """(4, 4) float32 of a Pose or a 4x4."""
    if isinstance(pose, Pose):
        return np.asarray(pose.matrix, dtype="f4")
    if np.shape(pose) == (3,):
        position = tuple(np.asarray(pose).tolist())
        raise InvalidArgument(
            f"{field}: a position alone is no pose: write hg.Pose({position})", field=field
        )
    if np.shape(pose) == (4,):
        raise InvalidArgument(
            f"{field}: a bare 4-vector says neither its order nor the position: write "
            "hg.Pose(position, wxyz=q) or hg.Pose(position, xyzw=q)",
            field=field,
        )
    return checked(pose, field, "<f4", (4, 4))


def packed_matrices(poses: Any, field: str = "transforms") -> NdArray | GpuArray:
    """matrices_of(), but an array on a GPU, (N, 4, 4) float32 or float64, stays there."""
    if is_on_gpu(poses):
        return GpuArray(poses, field, ("<f4", "<f8"), (None, 4, 4))
    return matrices_of(poses, field)


def matrices_of(poses: Any, field: str = "transforms") -> NdArray:
    """(N, 4, 4) float32 of an array or of a sequence of poses."""
    poses = on_host(poses)
    if isinstance(poses, np.ndarray):
        return checked(poses, field, "<f4", (None, 4, 4))
    listed = list(poses)
    if not listed:
        return np.zeros((0, 4, 4), dtype="<f4")
    return np.stack([matrix_of(pose, f"{field}[{i}]") for i, pose in enumerate(listed)])
