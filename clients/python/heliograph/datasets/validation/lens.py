"""Lens that fits pixels: checks K and the lens, and finds another one where they do not fit. Used
for saved frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..._wire.arrays import NdArray

_MOST = 0.8  # of the points must agree with the camera
RAY_TABLE = "ray_table"
_KINDS = ("perspective", "orthographic", "fisheye", "equirectangular")


class Lens(NamedTuple):
    """Lens of a saved frame. kind: a projection of docs/cameras.md, or "other", which is not
    checked further, such as a ray table, which gives no place in the image. K: (3, 3), fitted to
    the points; the file's, unless `stated` is False. distortion: OpenCV's."""

    kind: str
    K: NdArray
    stated: bool = True
    distortion: tuple[float, ...] = ()

    def sees(self, points: NdArray, beyond: float = 0.0) -> NdArray:
        """(N,) bool: which points may have an image: those farther ahead, where that matters."""
        if self.kind in ("fisheye", "equirectangular"):
            return np.ones(len(points), bool)
        return np.asarray(points[:, 2] > beyond)

    def project(self, points: NdArray) -> NdArray:
        """(N, 2) px of (N, 3) points of the camera's frame that it sees."""
        return np.asarray(self.flat(points) @ self.K[:2, :2].T + self.K[:2, 2])

    def flat(self, points: NdArray) -> NdArray:
        """(N, 2): the same before K."""
        x, y, z = np.asarray(points, float).T
        if self.kind == "orthographic":
            return np.column_stack([x, y])
        if self.kind == "equirectangular":
            return np.column_stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])
        if self.kind == "fisheye":
            return _fisheye(x, y, z, self.distortion)
        return _brown(x / z, y / z, self.distortion)


def _fisheye(x: NdArray, y: NdArray, z: NdArray, distortion: tuple[float, ...]) -> NdArray:
    """Kannala & Brandt 2006."""
    radius = np.hypot(x, y)
    angle = np.arctan2(radius, z)
    powers = [k * angle ** (2 * i + 2) for i, k in enumerate(distortion)]
    bent = angle * (1 + np.sum(powers, axis=0)) if powers else angle
    scale = bent / np.maximum(radius, 1e-30)
    return np.column_stack([x * scale, y * scale])


def _brown(a: NdArray, b: NdArray, distortion: tuple[float, ...]) -> NdArray:
    """Brown 1966, in OpenCV's order."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*distortion, *[0.0] * 8)[:8]
    r = a * a + b * b
    scale = (1 + r * (k1 + r * (k2 + r * k3))) / (1 + r * (k4 + r * (k5 + r * k6)))
    return np.column_stack(
        [
            a * scale + 2 * p1 * a * b + p2 * (r + 2 * a * a),
            b * scale + p1 * (r + 2 * b * b) + 2 * p2 * a * b,
        ]
    )


def stated(content: Mapping[str, Any], K: NdArray) -> Lens | None:
    """The lens that a label file names; None: it names none. ValueError: it is none."""
    kind = content.get("projection")
    if kind is None:
        return None
    if kind == RAY_TABLE:
        return Lens("other", K)
    if kind not in _KINDS:
        kinds = ", ".join((*_KINDS, RAY_TABLE))
        raise ValueError(f"projection is {kind!r}: needs one of {kinds}")
    return Lens(kind, K, True, tuple(float(k) for k in content.get("distortion") or ()))


def lens_of(named: Lens | None, K: NdArray, points: NdArray, seen: tuple[NdArray, float]) -> Lens:
    """points: (N, 3) of the camera's frame. seen: at which pixels (N, 2), and how exactly.

    A camera has the lens that is named, or without one is a pinhole or orthographic, when it brings
    four fifths of the points to their pixels, with K or another one.
    """
    if named and named.kind == "other":
        return named
    pixels, within = seen
    candidates = [named] if named else [Lens("perspective", K), Lens("orthographic", K)]
    if len(points) < 8:
        return candidates[0]
    for lens in candidates:
        visible = lens.sees(points)
        there, at = points[visible], pixels[visible]
        if _agree(lens.project(there), at, within) >= _MOST:
            return lens
        fitted = lens._replace(K=_fitted(lens.flat(there), at, within), stated=False)
        if _agree(fitted.project(there), at, within) >= _MOST:
            return fitted
    return Lens("other", K, named is None)


def _agree(seen: NdArray, pixels: NdArray, within: float) -> float:
    return float((np.abs(seen - pixels).max(1) <= within).mean()) if len(seen) else 0.0


def _fitted(flat: NdArray, pixels: NdArray, within: float) -> NdArray:
    """K by least squares over the points that fitted best before, repeatedly (least trimmed
    squares, Rousseeuw 1984)."""
    K = np.eye(3)
    for axis in (0, 1):
        rows = np.column_stack([flat[:, axis], np.ones(len(flat))])
        kept = np.ones(len(flat), bool)
        for _ in range(8):
            solution = np.linalg.lstsq(rows[kept], pixels[kept, axis], rcond=None)[0]
            error = np.abs(rows @ solution - pixels[:, axis])
            kept = error <= max(within, float(np.quantile(error, _MOST)))
        K[axis, axis], K[axis, 2] = solution
    return K
