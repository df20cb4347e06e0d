"""Whether pixels are where K says: and of what lens they are otherwise. Used for saved frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..._arrays import NdArray
from .geometry import project

_MOST = 0.8  # of the points: what they agree on is the camera's


class Lens(NamedTuple):
    """kind: "pinhole", "orthographic" or "other" (distorted, fisheye ...: not looked at further).
    K: (3, 3), what the points say, which is what was told unless `told` is False."""

    kind: str
    K: NdArray
    told: bool

    def project(self, points: NdArray) -> NdArray:
        """(N, 2) of (N, 3) points of the camera's frame."""
        if self.kind == "orthographic":
            flat = np.column_stack([points[:, :2], np.ones(len(points))])
            return np.asarray((flat @ self.K.T)[:, :2])
        return project(self.K, points)


def lens_of(K: NdArray, points: NdArray, pixels: NdArray, within: float) -> Lens:
    """points: (N, 3) of the camera's frame, z > 0, that are seen at pixels (N, 2).

    A camera is a pinhole, or orthographic, when an affine map of x / z, y / z, or of x, y, brings
    four fifths of the points to their pixels.
    """
    if len(points) < 8:
        return Lens("pinhole", K, True)
    for kind, flat in (("pinhole", points[:, :2] / points[:, 2:]), ("orthographic", points[:, :2])):
        told = Lens(kind, K, True)
        if _agree(told.project(points), pixels, within) >= _MOST:
            return told
        fitted = _fitted(flat, pixels, within)
        lens = Lens(kind, fitted, False)
        if _agree(lens.project(points), pixels, within) >= _MOST:
            return lens
    return Lens("other", K, True)


def _agree(seen: NdArray, pixels: NdArray, within: float) -> float:
    return float((np.abs(seen - pixels).max(1) <= within).mean())


def _fitted(flat: NdArray, pixels: NdArray, within: float) -> NdArray:
    """K by least squares, each time of those that fitted best before (least trimmed squares,
    Rousseeuw 1984)."""
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
