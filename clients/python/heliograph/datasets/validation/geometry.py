"""Rotations, quaternions and projection. Used by the formats' modules."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._wire.arrays import NdArray

ROTATION_WITHIN = 1e-3  # of R R^T from the identity: the error of five decimals in a file


def rotation_fault(rotation: NdArray) -> str:
    """Fault of a (3, 3) rotation; "" when there is none."""
    product = rotation @ rotation.T
    error = float(np.abs(product - np.eye(3)).max())
    if error > ROTATION_WITHIN:
        lengths = np.linalg.norm(rotation, axis=1)
        return (
            f"is no rotation: its rows have lengths {lengths.round(4).tolist()}, and R R^T is off "
            f"by {error:.2g}"
        )
    if np.linalg.det(rotation) < 0:
        return "mirrors (determinant -1): a rotation has determinant 1"
    return ""


def rotation_of(quaternion: Any, order: str) -> NdArray:
    """(3, 3) of a quaternion, normalised. order: "wxyz" or "xyzw"."""
    numbers = dict(zip(order, np.asarray(quaternion, float) / np.linalg.norm(quaternion)))
    w, x, y, z = (numbers[name] for name in "wxyz")
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def is_unit(quaternion: Any, within: float = 1e-3) -> bool:
    """Is its length 1?"""
    return bool(abs(np.linalg.norm(np.asarray(quaternion, float)) - 1) <= within)


def project(K: NdArray, points: NdArray) -> NdArray:
    """(N, 2) image coordinates of (N, 3) points of an OpenCV camera. K: (3, 3)."""
    raster = points @ K.T
    return np.asarray(raster[:, :2] / raster[:, 2:])


def wrapped(angle: float) -> float:
    """Angle, radians, within [-pi, pi)."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
