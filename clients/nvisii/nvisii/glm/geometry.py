"""GLM's functions of vectors as a whole."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .elementwise import like, numbers
from .quaternions import quat
from .vectors import Numbers, floats, vec3


def dot(x: Numbers, y: Numbers) -> float:
    return float(np.sum(_whole(x) * _whole(y)))


def length(x: Numbers) -> float:
    """The Euclidean length; of a quat, too."""
    return float(np.linalg.norm(_whole(x)))


def length2(x: Numbers) -> float:
    """The length squared."""
    return dot(x, x)


def distance(p0: Numbers, p1: Numbers) -> float:
    return float(np.linalg.norm(_whole(p0) - _whole(p1)))


def distance2(p0: Numbers, p1: Numbers) -> float:
    """The distance squared."""
    return distance(p0, p1) ** 2


def l1Norm(x: Numbers) -> float:
    """The sum of the components' sizes."""
    return float(np.abs(_whole(x)).sum())


def l2Norm(x: Numbers) -> float:
    return length(x)


def lMaxNorm(x: Numbers) -> float:
    """The largest of the components' sizes."""
    return float(np.abs(_whole(x)).max())


def cross(x: Numbers, y: Numbers) -> Any:
    (a, b, c), (d, e, f) = floats(x, 3, "x", finite=False), floats(y, 3, "y", finite=False)
    return vec3(b * f - c * e, c * d - a * f, a * e - b * d)


def normalize(x: Any) -> Any:
    """Scales a vector or quat to length 1. RuntimeError at length 0."""
    size = length(x)
    if size == 0:
        raise RuntimeError("normalize: length 0 has no direction")
    return x * (1 / size) if isinstance(x, quat) else like(_whole(x) / size, (x,))


def faceforward(N: Numbers, I: Numbers, Nref: Numbers) -> Any:  # noqa: E741 (GLM's name)
    """N, or -N where Nref looks along I."""
    return like(numbers(N) if dot(Nref, I) < 0 else -numbers(N), (N,))


def reflect(I: Numbers, N: Numbers) -> Any:  # noqa: E741
    return like(numbers(I) - 2 * dot(N, I) * numbers(N), (I, N))


def refract(I: Numbers, N: Numbers, eta: float) -> Any:  # noqa: E741
    """Snell's law; 0 where all is reflected."""
    cosine = dot(N, I)
    k = 1 - eta * eta * (1 - cosine * cosine)
    if k < 0:
        return like(numbers(I) * 0, (I, N))
    return like(eta * numbers(I) - (eta * cosine + math.sqrt(k)) * numbers(N), (I, N))


def proj(x: Numbers, Normal: Numbers) -> Any:
    """x projected onto Normal."""
    return like(numbers(Normal) * (dot(x, Normal) / dot(Normal, Normal)), (x, Normal))


def perp(x: Numbers, Normal: Numbers) -> Any:
    """Part of x that is perpendicular to Normal: x - proj(x, Normal)."""
    return like(numbers(x) - numbers(proj(x, Normal)), (x, Normal))


def angle_between(x: Numbers, y: Numbers) -> float:
    """Radians between two directions of any length."""
    cosine = dot(x, y) / (length(x) * length(y))
    return math.acos(min(max(cosine, -1.0), 1.0))


def orientedAngle(x: Numbers, y: Numbers, ref: Numbers = (0.0, 0.0, 1.0)) -> float:
    """Radians from x to y, counter-clockwise about ref; of vec2s in their plane."""
    a, b = (list(v) + [0.0] * (3 - len(v)) for v in (x, y))
    size = angle_between(a, b)
    return size if dot(ref, cross(a, b)) >= 0 else -size


def closestPointOnLine(point: Numbers, a: Numbers, b: Numbers) -> Any:
    """Point of the segment from a to b that is closest to `point`."""
    p, start, end = numbers(point), numbers(a), numbers(b)
    along = end - start
    t = np.clip((p - start) @ along / (along @ along), 0, 1)
    return like(start + along * t, (point, a, b))


def triangleNormal(p1: Numbers, p2: Numbers, p3: Numbers) -> Any:
    return normalize(cross(_of(p1, 3) - _of(p2, 3), _of(p1, 3) - _of(p3, 3)))


def polar(euclidean: Numbers) -> Any:
    """vec3(latitude, longitude, distance in the xz plane) of a point; +Y is up."""
    x, y, z = (_of(euclidean, 3) / length(euclidean)).tolist()
    return vec3(math.asin(y), math.atan2(x, z), math.hypot(x, z))


def euclidean(polar: Numbers) -> Any:
    """The direction of a latitude and a longitude; +Y is up."""
    latitude, longitude = (float(v) for v in list(polar)[:2])
    c = math.cos(latitude)
    return vec3(c * math.sin(longitude), math.sin(latitude), c * math.cos(longitude))


def _whole(value: Any) -> Any:
    if isinstance(value, quat):
        return np.array(tuple(value))
    return numbers(value)


def _of(value: Any, count: int) -> Any:
    array = numbers(value)
    if array.shape != (count,):
        raise RuntimeError(f"needs {count} numbers, not {value!r}")
    return array
