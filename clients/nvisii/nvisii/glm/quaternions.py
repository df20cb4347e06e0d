"""quat: quat(w, x, y, z), but q[0] .. q[3] are x, y, z, w, as in GLM."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..checks import number
from .vectors import Numbers, Numeric, floats, vec3, vec4


class quat(Numeric):
    """A quaternion. Made of nothing (the identity), of w, x, y, z, of w and a vector, of a mat3 or
    mat4, of Euler angles (a vec3, radians: about x, then y, then z), or of a quat."""

    __slots__ = ("w", "x", "y", "z")
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, *values: Any) -> None:
        if not values:
            values = (1.0, 0.0, 0.0, 0.0)
        elif len(values) == 1:
            values = _wxyz_of(values[0])
        elif len(values) == 2:
            values = (values[0], *values[1])
        try:
            self.w, self.x, self.y, self.z = map(float, values)
        except (TypeError, ValueError):
            raise RuntimeError(f"quat(w, x, y, z): needs 4 numbers, not {values!r}") from None

    def __len__(self) -> int:
        return 4

    def __iter__(self) -> Iterator[float]:
        return iter((self.x, self.y, self.z, self.w))

    def __getitem__(self, index: Any) -> Any:
        return (self.x, self.y, self.z, self.w)[index]

    def __setitem__(self, index: int, value: float) -> None:
        setattr(self, "xyzw"[index], float(value))

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(tuple(self), dtype=dtype)

    def __eq__(self, other: object) -> bool:
        return tuple(self) == tuple(other) if isinstance(other, quat) else NotImplemented

    def __repr__(self) -> str:
        return f"quat({self.w:f}, {{{self.x:f}, {self.y:f}, {self.z:f}}})"

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, quat):
            return product(self, other)
        if np.ndim(other) == 0:
            s = float(other)
            return quat(self.w * s, self.x * s, self.y * s, self.z * s)
        turned = rotation_of(self) @ np.array(list(other)[:3], dtype=float)
        if len(other) == 4:
            return vec4(*turned.tolist(), other[3])
        return vec3(*turned.tolist())

    def __rmul__(self, other: Any) -> Any:
        if np.ndim(other) == 0:
            return self * other
        return conjugate(self) * other

    def __truediv__(self, other: float) -> Any:
        return self * (1.0 / other)

    def __add__(self, other: quat) -> quat:
        return quat(self.w + other.w, self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: quat) -> quat:
        return self + -other

    def __neg__(self) -> quat:
        return quat(-self.w, -self.x, -self.y, -self.z)


def product(a: quat, b: quat) -> quat:
    """First b, then a."""
    return quat(
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
    )


def conjugate(q: quat) -> quat:
    return quat(q.w, -q.x, -q.y, -q.z)


def rotation_of(q: quat) -> Any:
    """(3, 3) float64 [row][column]; q need not have length 1."""
    length = math.sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z)
    if length == 0:
        raise RuntimeError("a quaternion of length 0 is no rotation")
    w, x, y, z = q.w / length, q.x / length, q.y / length, q.z / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def of_rotation(matrix: Any) -> quat:
    """Quaternion of a (3, 3) rotation [row][column]; Shepperd 1978: the largest component first."""
    m = np.asarray(matrix, dtype=float)
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    squares = [1 + trace, *(1 + 2 * m[i, i] - trace for i in range(3))]
    largest = int(np.argmax(squares))
    root = 2 * math.sqrt(max(squares[largest], 0.0))
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    rows = ((0, wx, wy, wz), (wx, 0, xy, xz), (wy, xy, 0, yz), (wz, xz, yz, 0))
    out = [value / root for value in rows[largest]]
    out[largest] = root / 4
    return quat(*out)


def quat_of(value: Numbers, name: str) -> quat:
    """A copy of a quat, or of 4 numbers in the order in which a quat is indexed: x, y, z, w."""
    x, y, z, w = floats(value, 4, name)
    return quat(w, x, y, z)


def _wxyz_of(value: Any) -> tuple[float, ...]:
    if isinstance(value, quat):
        return value.w, value.x, value.y, value.z
    array = np.array([list(v) if np.ndim(v) else v for v in value], dtype=float)
    if array.shape in ((3, 3), (4, 4)):
        return _wxyz_of(of_rotation(array.T[:3, :3]))
    if array.shape == (3,):
        c, s = np.cos(array / 2), np.sin(array / 2)
        about = [quat(c[i], *(s[i] if j == i else 0.0 for j in range(3))) for i in range(3)]
        return _wxyz_of(about[2] * about[1] * about[0])
    return _wxyz_of(quat_of(value, "quat"))


def angleAxis(angle: float, axis: Numbers) -> quat:
    """The rotation by `angle` radians about an axis of any length."""
    x, y, z = floats(axis, 3, "axis")
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0:
        raise RuntimeError("axis: has length 0")
    half = number("angle", angle) / 2
    s = math.sin(half) / length
    return quat(math.cos(half), x * s, y * s, z * s)
