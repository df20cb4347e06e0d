"""COLMAP's camera models. Used by colmap.py.

Source: https://colmap.github.io/cameras.html, src/colmap/sensor/models.h.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..._wire.arrays import NdArray

if TYPE_CHECKING:
    from .colmap import Camera

COUNTS = {
    "SIMPLE_PINHOLE": 3,
    "PINHOLE": 4,
    "SIMPLE_RADIAL": 4,
    "RADIAL": 5,
    "OPENCV": 8,
    "FULL_OPENCV": 12,
    "OPENCV_FISHEYE": 8,
}
_ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")


def seen_at(camera: Camera, points: NdArray) -> NdArray:
    """(N, 2) px of (N, 3) points of the camera's frame, z > 0."""
    given = list(camera.parameters)
    if camera.model in _ONE_FOCAL:
        given.insert(1, given[0])
    fx, fy, cx, cy, *k = given
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if camera.model == "OPENCV_FISHEYE":
        x, y = _fisheye(x, y, k)
    elif k:
        x, y = _radial(x, y, [*k, *[0.0] * 8][:2] + _rest(camera.model, k))
    return np.stack([fx * x + cx, fy * y + cy], axis=1)


def _rest(model: str, k: list[float]) -> list[float]:
    """p1 p2 k3 k4 k5 k6; SIMPLE_RADIAL and RADIAL have none."""
    return ([*k[2:]] + [0.0] * 6)[:6] if model in ("OPENCV", "FULL_OPENCV") else [0.0] * 6


def _radial(x: NdArray, y: NdArray, k: list[float]) -> tuple[NdArray, NdArray]:
    k1, k2, p1, p2, k3, k4, k5, k6 = k
    r = x * x + y * y
    scale = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
    return (
        x * scale + 2 * p1 * x * y + p2 * (r + 2 * x * x),
        y * scale + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
    )


def _fisheye(x: NdArray, y: NdArray, k: list[float]) -> tuple[NdArray, NdArray]:
    radius = np.hypot(x, y)
    angle = np.arctan(radius)
    square = angle * angle
    bent = angle
    power = square
    for coefficient in k:
        bent = bent + angle * coefficient * power
        power = power * square
    scale = np.where(radius > 1e-12, bent / np.maximum(radius, 1e-12), 1.0)
    return x * scale, y * scale
