"""Where the links of a robot are: joint values to matrices, for one set of values or many at once.
Used by robots.py.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML/joint, version 1.0).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._arrays import NdArray, checked
from .errors import InvalidArgument
from .pose import Pose
from .urdf import ONE_AXIS, Joint, Urdf

_COLUMNS = {
    "planar": ("x", "y", "angle"),
    "floating": ("x", "y", "z", "qw", "qx", "qy", "qz"),
}
_TOLERANCE = 1e-6  # of limits: values may come as float32


class Kinematics:
    """The joints of a robot as arrays.

    joint_names: of the C columns of an array of values: joints in the file's order, but fixed ones
    and those that mimic others. A planar joint has columns "<name>/x", "/y" (metres in the plane
    across its axis) and "/angle"; a floating one "/x", "/y", "/z", "/qw", "/qx", "/qy", "/qz".
    limits: (C, 2). rest: (C,), 0 or the limit next to it. moving: the M joints that are not fixed.
    """

    def __init__(self, urdf: Urdf) -> None:
        self.link_names = urdf.links
        self.joints = urdf.joints
        self.moving = [joint for joint in urdf.joints if joint.kind != "fixed"]
        self.joint_names: list[str] = []
        self._first: dict[str, int] = {}  # column of a joint
        for joint in self.moving:
            if joint.mimic is None:
                self._first[joint.name] = len(self.joint_names)
                self.joint_names.extend(_columns(joint))
        self._fill_limits()
        self._fill_motions()
        self._fill_tree()

    def _fill_limits(self) -> None:
        self.limits = np.tile((-math.inf, math.inf), (len(self.joint_names), 1))
        self.rest = np.zeros(len(self.joint_names))
        for joint in self.moving:
            at = self._first.get(joint.name)
            if at is None:
                continue
            if joint.kind in ONE_AXIS:
                self.limits[at] = joint.lower, joint.upper
                self.rest[at] = np.clip(0.0, joint.lower, joint.upper)
            elif joint.kind == "floating":
                self.rest[at + 3] = 1.0

    def _fill_motions(self) -> None:
        """Angles and lengths are values @ _weights + _offsets, (C, M) and (M,)."""
        count = len(self.moving)
        self._weights = np.zeros((len(self.joint_names), count))
        self._offsets = np.zeros(count)
        self._origins = np.array([j.origin for j in self.moving]).reshape(count, 4, 4)
        self._slides = np.zeros((count, 3))
        self._crosses = np.zeros((count, 3, 3))
        by_name = {joint.name: joint for joint in self.moving}
        for i, joint in enumerate(self.moving):
            if joint.kind == "floating":
                continue
            source, factor, offset = _followed(joint, by_name)
            column = self._first[source.name] + (2 if joint.kind == "planar" else 0)
            self._weights[column, i], self._offsets[i] = factor, offset
            if joint.kind == "prismatic":
                self._slides[i] = joint.axis
            else:
                self._crosses[i] = _cross(joint.axis)

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

    def _amounts(self, values: NdArray) -> NdArray:
        """(..., M): how far the moving joints are turned or slid, mimics too."""
        return np.asarray(values @ self._weights + self._offsets)

    def local(self, values: NdArray) -> NdArray:
        """(..., M, 4, 4) float64 parent_from_child of the moving joints, of (..., C) values."""
        q = self._amounts(values)
        out = np.zeros((*q.shape, 4, 4))
        out[..., 3, 3] = 1
        sine, cosine = (f(q)[..., None, None] for f in (np.sin, np.cos))
        k = self._crosses
        out[..., :3, :3] = np.eye(3) + sine * k + (1 - cosine) * (k @ k)  # Rodrigues
        out[..., :3, 3] = q[..., None] * self._slides
        for i, joint in enumerate(self.moving):
            at = self._first.get(joint.name, 0)
            if joint.kind == "planar":
                out[..., i, :3, 3] = values[..., at : at + 2] @ _plane(joint.axis)
            elif joint.kind == "floating":
                out[..., i, :3, 3] = values[..., at : at + 3]
                out[..., i, :3, :3] = _rotations(values[..., at + 3 : at + 7])
        return np.asarray(self._origins @ out)

    def angles(self, values: NdArray) -> NdArray:
        """(..., M) radians that the moving joints are turned about their axes."""
        turns = self._crosses.any(axis=(1, 2))
        return np.asarray(self._amounts(values) * turns)

    def forward(self, values: NdArray) -> NdArray:
        """(..., L, 4, 4) float64 root_from_link, of (..., C) values."""
        local = self.local(values)
        out = np.empty((*values.shape[:-1], len(self.link_names), 4, 4))
        out[..., 0, :, :] = np.eye(4)
        for link, parent, own in self._tree:
            step = local[..., own, :, :] if isinstance(own, int) else own
            out[..., link, :, :] = out[..., parent, :, :] @ step
        return out

    # ------------------------------------------------------------ values

    def values(self, given: Any, clamp: bool = False) -> NdArray:
        """(..., C) float64 of an array (C,) or (N, C), or of {name: number or (N,)}, whose other
        joints rest; within the limits, and floating rotations of length 1."""
        out = self._of_names(given) if isinstance(given, Mapping) else self._of_array(given)
        for joint in self.moving:
            if joint.kind == "floating":
                at = self._first[joint.name] + 3
                length = np.linalg.norm(out[..., at : at + 4], axis=-1, keepdims=True)
                if (length < 1e-9).any():
                    raise InvalidArgument(
                        f"values: joint {joint.name!r} has a quaternion of length 0",
                        field=f"values[{joint.name!r}]",
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

    def _of_names(self, given: Mapping[str, Any]) -> NdArray:
        columns: dict[int, NdArray] = {}
        for name, value in given.items():
            field = f"values[{name!r}]"
            for column, number in self._named(name, value, field).items():
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
        low, high = self.limits.T
        slack = _TOLERANCE * np.maximum(1.0, np.where(np.isfinite(low), np.abs(low), 1.0))
        slack_high = _TOLERANCE * np.maximum(1.0, np.where(np.isfinite(high), np.abs(high), 1.0))
        outside = np.argwhere((values < low - slack) | (values > high + slack_high))
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
        """Which of the moving joints columns or joints of these names move; mimics follow."""
        columns = [c for name in names for c in self._columns_of(name)]
        hit: NdArray = np.any(self._weights[columns] != 0, axis=0)
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


def _followed(joint: Joint, joints: Mapping[str, Joint]) -> tuple[Joint, float, float]:
    """The joint that moves this one, with the factor and the offset of its value."""
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = joints[joint.mimic.joint]
    return joint, factor, offset


def _cross(axis: NdArray) -> NdArray:
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _plane(axis: NdArray) -> NdArray:
    """(2, 3): the joint's x and y axes, turned the shortest way from its z axis to `axis`."""
    x, y, z = axis
    if z < -1 + 1e-12:
        return np.array([[1.0, 0, 0], [0, -1.0, 0]])
    k = _cross(np.array([-y, x, 0.0]))  # z axis cross `axis`
    turn = np.eye(3) + k + k @ k / (1 + z)
    return np.asarray(turn[:, :2].T)


def _floating_values(value: Any, field: str) -> NdArray:
    """(..., 7): position, and the quaternion w x y z, of a Pose, (4, 4) or (N, 4, 4)."""
    given = value.matrix if isinstance(value, Pose) else value
    leading = (None,) if np.ndim(given) == 3 else ()
    matrices = checked(given, field, "f8", (*leading, 4, 4))
    rotation = matrices[..., :3, :3]
    error = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(initial=0)
    if error > 1e-5 or (np.linalg.det(rotation) < 0).any():
        raise InvalidArgument(f"{field}: needs a rotation without scale", field=field)
    return np.concatenate([matrices[..., :3, 3], _quaternions(rotation)], axis=-1)


def _rotations(wxyz: NdArray) -> NdArray:
    """(..., 3, 3) of unit quaternions (..., 4)."""
    w, v = wxyz[..., :1, None], wxyz[..., 1:]
    k = np.zeros((*v.shape, 3))
    for (i, j), n in {(2, 1): 0, (0, 2): 1, (1, 0): 2}.items():
        k[..., i, j], k[..., j, i] = v[..., n], -v[..., n]
    return np.asarray(np.eye(3) + 2 * w * k + 2 * k @ k)


def _quaternions(rotation: NdArray) -> NdArray:
    """(..., 4) w x y z: the column of the largest element of 4 q q^T (Shepperd 1978)."""
    r = rotation
    trace = np.trace(r, axis1=-2, axis2=-1)[..., None, None]
    skew = np.stack([r[..., j, i] - r[..., i, j] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
    products = np.empty((*r.shape[:-2], 4, 4))
    products[..., 0, 0] = 1 + trace[..., 0, 0]
    products[..., 0, 1:] = products[..., 1:, 0] = skew
    products[..., 1:, 1:] = r + np.swapaxes(r, -1, -2) + (1 - trace) * np.eye(3)
    best = np.diagonal(products, axis1=-2, axis2=-1).argmax(axis=-1)
    column = np.take_along_axis(products, best[..., None, None], axis=-1)[..., 0]
    return np.asarray(column / np.linalg.norm(column, axis=-1, keepdims=True))
