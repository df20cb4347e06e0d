"""GLM's functions of quaternions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .elementwise import like, numbers
from .geometry import cross, dot, normalize
from .matrices import Matrix, mat3, mat4, rows_of
from .quaternions import angleAxis, conjugate, of_rotation, quat, quat_of, rotation_of
from .vectors import Numbers, floats, vec3


def angle(x: quat) -> float:
    """Radians by which it turns, in [0, 2 pi]."""
    return 2 * math.atan2(math.sqrt(x.x * x.x + x.y * x.y + x.z * x.z), x.w)


def axis(x: quat) -> Any:
    """The unit axis about which it turns; +Z of none."""
    size = math.sqrt(x.x * x.x + x.y * x.y + x.z * x.z)
    return vec3(x.x / size, x.y / size, x.z / size) if size > 0 else vec3(0, 0, 1)


def mat3_cast(x: Numbers) -> Any:
    """The rotation as a matrix."""
    return mat3.of(rotation_of(quat_of(x, "x")))


def mat4_cast(x: Numbers) -> Any:
    out = np.eye(4)
    out[:3, :3] = rotation_of(quat_of(x, "x"))
    return mat4.of(out)


def toMat3(x: Numbers) -> Any:
    return mat3_cast(x)


def toMat4(x: Numbers) -> Any:
    return mat4_cast(x)


def quat_cast(x: Any) -> quat:
    """The rotation of a mat3 or mat4."""
    size = x.size if isinstance(x, Matrix) else len(x)
    return of_rotation(rows_of(x, size, "x")[:3, :3])


def toQuat(x: Any) -> quat:
    return quat_cast(x)


def quatLookAt(direction: Numbers, up: Numbers) -> quat:
    """Turns -Z to a direction of length 1, +Y as near to up as it can."""
    back = -np.array(floats(direction, 3, "direction"))
    right = np.cross(floats(up, 3, "up"), back)
    size = float(np.linalg.norm(right))
    if size < 1e-12:
        raise RuntimeError("quatLookAt: direction and up are parallel")
    right /= size
    return of_rotation(np.stack([right, np.cross(back, right), back], axis=1))


def quatLookAtRH(direction: Numbers, up: Numbers) -> quat:
    return quatLookAt(direction, up)


def rotation(orig: Numbers, dest: Numbers) -> quat:
    """The shortest one that takes one unit direction to another."""
    a, b = vec3(*floats(orig, 3, "orig")), vec3(*floats(dest, 3, "dest"))
    cosine = dot(a, b)
    if cosine > 1 - 1e-12:
        return quat()
    if cosine < -1 + 1e-12:
        helper = vec3(0, 0, 1) if abs(a.z) < 0.9 else vec3(1, 0, 0)
        return angleAxis(math.pi, cross(helper, a))
    turn: quat = normalize(quat(1 + cosine, *cross(a, b)))
    return turn


def slerp(x: quat, y: quat, a: float) -> Any:
    """Along the shorter arc; Shoemake 1985."""
    return along_arc(x, -y if dot(x, y) < 0 else y, float(a))


def shortMix(x: quat, y: quat, a: float) -> Any:
    return slerp(x, y, a)


def lerp(x: quat, y: quat, a: float) -> Any:
    """Component by component."""
    return x * (1 - a) + y * a


def along_arc(x: quat, y: quat, a: float) -> Any:
    """Along the arc from x to y, the longer one where that is it."""
    cosine = dot(x, y)
    if cosine > 1 - 1e-9:
        return lerp(x, y, a)
    between = math.acos(max(-1.0, min(1.0, cosine)))
    sine = math.sin(between)
    if sine < 1e-12:
        return lerp(x, y, a)
    return x * (math.sin((1 - a) * between) / sine) + y * (math.sin(a * between) / sine)


def pitch(x: quat) -> float:
    """Radians about x of eulerAngles."""
    return math.atan2(2 * (x.y * x.z + x.w * x.x), x.w**2 - x.x**2 - x.y**2 + x.z**2)


def yaw(x: quat) -> float:
    """Radians about y of eulerAngles."""
    return math.asin(max(-1.0, min(1.0, -2 * (x.x * x.z - x.w * x.y))))


def roll(x: quat) -> float:
    """Radians about z of eulerAngles."""
    return math.atan2(2 * (x.x * x.y + x.w * x.z), x.w**2 + x.x**2 - x.y**2 - x.z**2)


def eulerAngles(x: quat) -> Any:
    """vec3 of pitch, yaw and roll: about x, then y, then z."""
    return vec3(pitch(x), yaw(x), roll(x))


def inverse(m: Any) -> Any:
    """Inverse of a mat2, mat3, mat4 or quat. RuntimeError for a singular matrix."""
    if isinstance(m, quat):
        return conjugate(m) / dot(m, m)
    matrix = _matrix(m)
    try:
        return type(matrix).of(np.linalg.inv(matrix.rows))
    except np.linalg.LinAlgError:
        raise RuntimeError("inverse: the matrix has none") from None


def mix(x: Any, y: Any, a: Any) -> Any:
    """x where a is 0, y where it is 1; of quats along the arc between them."""
    if isinstance(x, quat):
        return along_arc(x, y, float(a))
    if isinstance(a, bool):
        return y if a else x
    start, end, share = map(numbers, (x, y, a))
    return like(np.asarray(start * (1 - share) + end * share), (x, y, a))


def _matrix(m: Any) -> Any:
    if isinstance(m, Matrix):
        return m
    return mat4(m) if len(m) == 4 else mat3(m)
