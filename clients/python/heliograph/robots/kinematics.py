"""Forward kinematics: joint values to the poses of links, for one set of values or many at once.
Used by robots.py.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML/joint, version 1.0).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._wire.arrays import NdArray, checked
from .._wire.tensors import is_tensor, on_host
from ..errors import InvalidArgument
from ..values.pose import Pose
from ..values.rotations import quaternions_of, slerp
from ._motion import Motion
from .description import ONE_AXIS, Joint, RobotModel

_COLUMNS = {
    "planar": ("x", "y", "angle"),
    "floating": ("x", "y", "z", "qw", "qx", "qy", "qz"),
    "spherical": ("qw", "qx", "qy", "qz"),
}
_SHORTEST = 1e-9  # quaternion


class Kinematics:
    """The joints of a robot as arrays.

    joint_names: of the C columns of an array of values: joints in the file's order, without fixed
    ones and mimics. A planar joint has columns "<name>/x", "/y" (metres in the plane across its
    axis) and "/angle"; a floating one "/x", "/y", "/z", "/qw", "/qx", "/qy", "/qz",
    a spherical one the last four.
    limits: (C, 2), radians or metres. rest: (C,), the joints' own, clamped to the limits unless
    they are soft. moving: the M joints that are not fixed.
    """

    def __init__(self, model: RobotModel) -> None:
        self.link_names = model.links
        self.joints = model.joints
        self.moving = [joint for joint in model.joints if joint.kind != "fixed"]
        self.joint_names: list[str] = []
        self._first: dict[str, int] = {}  # column of a joint
        for joint in self.moving:
            if joint.mimic is None:
                self._first[joint.name] = len(self.joint_names)
                self.joint_names.extend(_columns(joint))
        self._fill_limits(model.soft_limits)
        self._motion = Motion(self.moving, self._first, self.limits, model.soft_limits)
        self._fill_tree()

    def _fill_limits(self, soft: bool) -> None:
        self.limits = np.tile((-math.inf, math.inf), (len(self.joint_names), 1))
        self.rest = np.zeros(len(self.joint_names))
        for joint in self.moving:
            at = self._first.get(joint.name)
            if at is None:
                continue
            if joint.kind in ONE_AXIS:
                self.limits[at] = joint.lower, joint.upper
            elif joint.kind != "planar":
                self.rest[at + _COLUMNS[joint.kind].index("qw")] = 1.0
            if joint.rest:
                self.rest[at : at + len(joint.rest)] = joint.rest
        if not soft:
            self.rest = np.clip(self.rest, *self.limits.T)

    def _fill_tree(self) -> None:
        rows = {name: i for i, name in enumerate(self.link_names)}
        above = {joint.child: joint for joint in self.joints}
        at = {joint.name: i for i, joint in enumerate(self.moving)}
        self._tree: list[tuple[int, int, int | NdArray]] = []
        for name in self.link_names[1:]:
            joint = above[name]
            own: int | NdArray = at[joint.name] if joint.kind != "fixed" else joint.origin
            self._tree.append((rows[name], rows[joint.parent], own))

    # ------------------------------------------------------------ matrices

    def local(self, values: Any) -> Any:
        """(..., M, 4, 4) float64 parent_from_child of the moving joints, of (..., C) values."""
        return self._motion.on(values).local(values)

    def turned(self, begin: NdArray, end: NdArray) -> float:
        """The most radians that a joint turns from some values to others, (..., C)."""
        turns = [self._motion.angles(end) - self._motion.angles(begin)]
        for _, at in self._motion.quaternions():
            cosine = np.sum(begin[..., at : at + 4] * end[..., at : at + 4], axis=-1)
            turns.append(2 * np.arccos(np.minimum(np.abs(cosine), 1)))
        return max(float(np.abs(turn).max(initial=0)) for turn in turns)

    def between(self, begin: NdArray, end: NdArray, share: float) -> NdArray:
        """Values on the way from some to others; quaternions turn evenly, the shorter way."""
        out = begin + share * (end - begin)
        for _, at in self._motion.quaternions():
            part = np.s_[..., at : at + 4]
            out[part] = slerp(begin[part], end[part], share)
        return np.asarray(out)

    def forward(self, values: Any) -> Any:
        """(..., L, 4, 4) float64 root_from_link, of (..., C) values."""
        return self._motion.on(values).forward(values, self._tree)

    # ------------------------------------------------------------ values

    def values(self, given: Any, clamp: bool = False) -> Any:
        """(..., C) float64 of an array (C,) or (N, C), or of {name: number or (N,)}, whose other
        joints rest; within the limits, and floating rotations of length 1. A tensor of PyTorch
        gives a tensor on the same device, without a gradient."""
        if is_tensor(given):
            return self._of_tensor(given, clamp)
        out = self._of_names(given) if isinstance(given, Mapping) else self._of_array(given)
        for i, at in self._motion.quaternions():
            length = np.linalg.norm(out[..., at : at + 4], axis=-1, keepdims=True)
            if (length < _SHORTEST).any():
                name = self.moving[i].name
                raise InvalidArgument(
                    f"values: joint {name!r} has a quaternion of length 0",
                    field=f"values[{name!r}]",
                )
            out[..., at : at + 4] /= length
        low, high = self.limits.T
        if clamp:
            return np.clip(out, low, high)
        self._check_limits(out)
        return out

    def _of_array(self, given: Any) -> NdArray:
        shape: tuple[int | None, ...] = (len(self.joint_names),)
        return checked(
            given, "values", "f8", shape if np.ndim(given) == 1 else (None, *shape)
        ).copy()

    def _of_tensor(self, given: Any, clamp: bool) -> Any:
        """Reads a tensor of values. A faulty one raises the error of its copy on the host."""
        motion = self._motion.on(given)
        out = motion.constant(given.detach()).clone()
        low, high, below, above = motion.bounds
        are_good = out.ndim in (1, 2) and out.shape[-1] == len(low)
        if are_good:
            for _, at in motion.quaternions():
                length = (out[..., at : at + 4] ** 2).sum(-1, keepdim=True).sqrt()
                out[..., at : at + 4] /= length.masked_fill(length < _SHORTEST, math.nan)
            within = out.isfinite() & (clamp or (out >= below) & (out <= above))
            are_good = bool(within.all())
        if not are_good:
            return motion.constant(self.values(on_host(given), clamp))
        return out.clip(low, high) if clamp else out

    def _of_names(self, given: Mapping[str, Any]) -> NdArray:
        columns: dict[int, NdArray] = {}
        for name, value in given.items():
            field = f"values[{name!r}]"
            for column, number in self._named(name, on_host(value), field).items():
                columns[column] = checked(number, field, "f8", (None,) * np.ndim(number))
        shapes = {c.shape for c in columns.values() if c.shape}
        if len(shapes) > 1 or any(len(shape) > 1 for shape in shapes):
            listed = ", ".join(map(str, sorted(shapes)))
            raise InvalidArgument(
                f"values: shapes {listed} do not go together; give numbers, or (N,) of one N",
                field="values",
            )
        out = np.tile(self.rest, (*(shapes.pop() if shapes else ()), 1))
        for column, number in columns.items():
            out[..., column] = number
        return out

    def _named(self, name: str, value: Any, field: str) -> dict[int, Any]:
        """The columns that one name of a mapping sets."""
        if name in self.joint_names:
            return {self.joint_names.index(name): value}
        joint = next((j for j in self.moving if j.name == name), None)
        if joint is None or joint.mimic is not None:
            raise self._unknown(name, field)
        at = self._first[name]
        if joint.kind == "planar":
            row = np.moveaxis(np.asarray(value, dtype="f8"), -1, 0)
            if row.shape[:1] != (3,):
                raise InvalidArgument(f"{field}: needs (x, y, angle), or (N, 3)", field=field)
        elif joint.kind == "spherical":
            row = np.moveaxis(_spherical_values(value, field), -1, 0)
        else:
            row = np.moveaxis(_floating_values(value, field), -1, 0)
        return {at + i: number for i, number in enumerate(row)}

    def _unknown(self, name: str, field: str) -> InvalidArgument:
        why = "there is no such joint"
        for joint in self.joints:
            if joint.name == name and joint.mimic is not None:
                why = f"it mimics {joint.mimic.joint!r}, which moves it"
            elif joint.name == name:
                why = "it is fixed"
        near = difflib.get_close_matches(name, self.joint_names, 3) or self.joint_names
        return InvalidArgument(
            f"{field}: {why}; joints are {', '.join(near)}", field=field, nearest=near
        )

    def _check_limits(self, values: NdArray) -> None:
        low, high, below, above = self._motion.bounds
        outside = np.argwhere((values < below) | (values > above))
        if len(outside):
            *row, column = (int(i) for i in outside[0])
            name = self.joint_names[column]
            at = "".join(f"[{i}]" for i in row)
            raise InvalidArgument(
                f"values{at}: joint {name!r} is at {values[tuple(outside[0])]:.6g}, outside its "
                f"limits [{low[column]:.6g}, {high[column]:.6g}]; keep within them, or give "
                "clamp=True",
                field=f"values{at}[{name!r}]",
            )

    def moved_by(self, names: Sequence[str]) -> list[int]:
        """Indices of the moving joints that columns or joints of these names move; mimics follow.
        InvalidArgument for some columns of a joint with several."""
        columns = [c for name in names for c in self._columns_of(name)]
        hit = self._motion.follows(columns)
        for i, joint in enumerate(self.moving):
            if joint.kind in _COLUMNS:
                first = self._first[joint.name]
                own = range(first, first + len(_COLUMNS[joint.kind]))
                hit[i] = any(c in own for c in columns)
                if hit[i] and not set(own) <= set(columns):
                    raise InvalidArgument(
                        f"values: give all columns of {joint.name!r}, or {joint.name!r} itself",
                        field=f"values[{joint.name!r}]",
                    )
        return [int(i) for i in np.flatnonzero(hit)]

    def _columns_of(self, name: str) -> list[int]:
        if name in self.joint_names:
            return [self.joint_names.index(name)]
        first = self._first[name]
        joint = next(j for j in self.moving if j.name == name)
        return list(range(first, first + len(_COLUMNS[joint.kind])))


def _columns(joint: Joint) -> list[str]:
    if joint.kind in _COLUMNS:
        return [f"{joint.name}/{column}" for column in _COLUMNS[joint.kind]]
    return [joint.name]


def _floating_values(value: Any, field: str) -> NdArray:
    """(..., 7): position, and the quaternion w x y z, of a Pose, (4, 4) or (N, 4, 4); or as they
    are, (7,) or (N, 7)."""
    given = value.matrix if isinstance(value, Pose) else value
    if np.shape(given)[-1:] == (7,):
        return checked(given, field, "f8", np.shape(given))
    matrices = _matrices(given, field, 4)
    rotation = _rotations(matrices[..., :3, :3], field)
    return np.concatenate([matrices[..., :3, 3], quaternions_of(rotation)], axis=-1)


def _spherical_values(value: Any, field: str) -> NdArray:
    """(..., 4): the quaternion w x y z of a rotation; or as they are, (4,) or (N, 4)."""
    shape = np.shape(value)
    if isinstance(value, Pose) or shape[-2:] == (3, 3):
        return quaternions_of(_rotations(value, field))
    is_pose = shape == (4, 4) and np.array_equal(value[3], (0, 0, 0, 1))
    if shape[-1:] != (4,) or is_pose:
        raise InvalidArgument(
            f"{field}: needs a rotation (3, 3) or (qw, qx, qy, qz), or N of them", field=field
        )
    return checked(value, field, "f8", shape)


def _rotations(value: Any, field: str) -> NdArray:
    """(..., 3, 3), of a Pose that turns alone, (3, 3) or (N, 3, 3)."""
    if isinstance(value, Pose):
        if np.abs(value.matrix[:3, 3]).max() > 0:
            raise InvalidArgument(f"{field}: turns, and stays in its place", field=field)
        value = value.matrix[:3, :3]
    rotation = _matrices(value, field, 3)
    error = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(initial=0)
    if error > 1e-5 or (np.linalg.det(rotation) < 0).any():
        raise InvalidArgument(f"{field}: needs a rotation without scale", field=field)
    return rotation


def _matrices(value: Any, field: str, size: int) -> NdArray:
    leading = (None,) if np.ndim(value) == 3 else ()
    return checked(value, field, "f8", (*leading, size, size))
