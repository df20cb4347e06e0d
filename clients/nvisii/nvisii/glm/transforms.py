"""GLM's functions of matrices, and the matrices of cameras; depth in clip space is in [-1, 1]."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .elementwise import numbers
from .matrices import Matrix, mat2, mat3, mat4, rows_of
from .overloads import overloaded
from .quaternions import angleAxis, quat, rotation_of
from .rotations import inverse
from .vectors import BY_SIZE, Numbers, floats, vec2, vec3


def transpose(x: Matrix) -> Any:
    return type(x).of(x.rows.T)


def determinant(m: Matrix) -> float:
    return float(np.linalg.det(m.rows))


def affineInverse(m: Matrix) -> Any:
    return inverse(m)


def inverseTranspose(m: Matrix) -> Any:
    return transpose(inverse(m))


def matrixCompMult(x: Matrix, y: Matrix) -> Any:
    """Component by component."""
    return type(x).of(x.rows * y.rows)


def outerProduct(c: Numbers, r: Numbers) -> Any:
    kinds: Any = {2: mat2, 3: mat3, 4: mat4}
    return kinds[len(c)].of(np.outer(numbers(c), numbers(r)))


def row(m: Matrix, index: int, x: Numbers = None) -> Any:
    """A row; with x, the matrix with that row replaced."""
    rows = m.rows.copy()
    if x is None:
        return BY_SIZE[m.size](*rows[index].tolist())
    rows[index] = numbers(x)
    return type(m).of(rows)


def column(m: Matrix, index: int, x: Numbers = None) -> Any:
    """A column; with x, the matrix with that column replaced."""
    rows = m.rows.copy()
    if x is None:
        return BY_SIZE[m.size](*rows[:, index].tolist())
    rows[:, index] = numbers(x)
    return type(m).of(rows)


@overloaded(("m", "v"), ("v",))
def translate(*arguments: Any) -> Any:
    """translate(v), or translate(m, v): m times the translation."""
    matrix, (v,) = _optional_matrix(arguments, 1, "translate(m, v)")
    out = np.eye(4)
    out[:3, 3] = floats(v, 3, "v")
    return mat4.of(matrix @ out)


@overloaded(("m", "v"), ("v",))
def scale(*arguments: Any) -> Any:
    """scale(v), or scale(m, v): m times the scaling."""
    matrix, (v,) = _optional_matrix(arguments, 1, "scale(m, v)")
    return mat4.of(matrix @ np.diag([*floats(v, 3, "v"), 1.0]))


@overloaded(
    ("m", "angle", "axis"),
    ("q", "angle", "axis"),
    ("v", "angle", "normal"),
    ("angle", "axis"),
    ("v", "angle"),
    ("q", "v"),
)
def rotate(*arguments: Any) -> Any:
    """rotate(m, angle, axis) or rotate(angle, axis): m times the rotation. rotate(q, angle, axis):
    q times it. rotate(q, v): v turned. rotate(v, angle), rotate(v, angle, normal): the same."""
    first: Any = arguments[0] if arguments else None
    if isinstance(first, quat) and len(arguments) == 2:
        return first * arguments[1]
    if isinstance(first, quat) and len(arguments) == 3:
        return first * angleAxis(*arguments[1:])
    if np.ndim(first) == 1 and len(arguments) == 2:
        c, s = math.cos(arguments[1]), math.sin(arguments[1])
        x, y = floats(first, 2, "v")
        return vec2(c * x - s * y, s * x + c * y)
    if np.ndim(first) == 1 and len(arguments) == 3:
        return angleAxis(*arguments[1:]) * vec3(*floats(first, 3, "v"))
    matrix, (angle, axis) = _optional_matrix(arguments, 2, "rotate(m, angle, axis)")
    out = np.eye(4)
    out[:3, :3] = rotation_of(angleAxis(angle, axis))
    return mat4.of(matrix @ out)


def rotateX(v: Numbers, angle: float) -> Any:
    return rotate(v, angle, (1.0, 0.0, 0.0))


def rotateY(v: Numbers, angle: float) -> Any:
    return rotate(v, angle, (0.0, 1.0, 0.0))


def rotateZ(v: Numbers, angle: float) -> Any:
    return rotate(v, angle, (0.0, 0.0, 1.0))


def _optional_matrix(arguments: tuple[Any, ...], count: int, usage: str) -> tuple[Any, Any]:
    if len(arguments) == count:
        return np.eye(4), arguments
    if len(arguments) != count + 1:
        raise RuntimeError(f"usage: {usage}")
    return rows_of(arguments[0], 4, "m"), arguments[1:]


# ---------------------------------------------------------------- cameras


def lookAt(eye: Numbers, center: Numbers, up: Numbers) -> Any:
    """Camera from world, of a camera that looks along its -Z."""
    place, at = (np.array(floats(v, 3, n)) for v, n in ((eye, "eye"), (center, "center")))
    back = place - at
    right = np.cross(floats(up, 3, "up"), back)
    if np.linalg.norm(right) == 0:
        raise RuntimeError("lookAt: needs a center that is not eye, and an up across the view")
    back, right = back / np.linalg.norm(back), right / np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = np.stack([right, np.cross(back, right), back])
    out[:3, 3] = -out[:3, :3] @ place
    return mat4.of(out)


def lookAtRH(eye: Numbers, center: Numbers, up: Numbers) -> Any:
    return lookAt(eye, center, up)


def perspective(fovy: float, aspect: float, near: float, far: float) -> Any:
    """fovy: vertical, radians."""
    top = math.tan(fovy / 2) * near
    right = top * aspect
    return frustum(-right, right, -top, top, near, far)


def perspectiveFov(fov: float, width: float, height: float, near: float, far: float) -> Any:
    return perspective(fov, width / height, near, far)


def infinitePerspective(fovy: float, aspect: float, near: float) -> Any:
    """perspective() whose far is at infinity."""
    rows = perspective(fovy, aspect, near, 2 * near).rows
    rows[2] = (0, 0, -1, -2 * near)
    return mat4.of(rows)


def frustum(left: float, right: float, bottom: float, top: float, near: float, far: float) -> Any:
    w, h, d = right - left, top - bottom, far - near
    return mat4.of(
        [
            [2 * near / w, 0, (right + left) / w, 0],
            [0, 2 * near / h, (top + bottom) / h, 0],
            [0, 0, -(far + near) / d, -2 * far * near / d],
            [0, 0, -1, 0],
        ]
    )


def ortho(
    left: float, right: float, bottom: float, top: float, zNear: float = -1.0, zFar: float = 1.0
) -> Any:
    w, h, d = right - left, top - bottom, zFar - zNear
    return mat4.of(
        [
            [2 / w, 0, 0, -(right + left) / w],
            [0, 2 / h, 0, -(top + bottom) / h],
            [0, 0, -2 / d, -(zFar + zNear) / d],
            [0, 0, 0, 1],
        ]
    )


def project(obj: Numbers, model: Matrix, proj: Matrix, viewport: Numbers) -> Any:
    """Window coordinates, row 0 at the bottom, and depth in [0, 1]. viewport: x, y, w, h."""
    clip = proj.rows @ model.rows @ np.array([*floats(obj, 3, "obj"), 1.0])
    ndc = clip[:3] / clip[3]
    x, y, w, h = floats(viewport, 4, "viewport")
    u, v, depth = (0.5 + 0.5 * ndc).tolist()
    return vec3(x + u * w, y + v * h, depth)


def unProject(win: Numbers, model: Matrix, proj: Matrix, viewport: Numbers) -> Any:
    """Inverse of project(): window coordinates (x, y, depth) to a point."""
    x, y, w, h = floats(viewport, 4, "viewport")
    u, v, depth = floats(win, 3, "win")
    ndc = np.array([2 * (u - x) / w - 1, 2 * (v - y) / h - 1, 2 * depth - 1, 1.0])
    world = inverse(proj * model).rows @ ndc
    return vec3(*(world[:3] / world[3]).tolist())


def orthonormalize(m: Matrix) -> Any:
    """The columns made orthonormal, one after the other."""
    q, r = np.linalg.qr(m.rows)
    return type(m).of(q * np.sign(np.diag(r)))
