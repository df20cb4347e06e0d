"""Rotations as unit quaternions w x y z. Used by robots and by writers of scenes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._wire.arrays import NdArray


def quaternions_of(rotation: NdArray) -> NdArray:
    """(..., 4) of rotations (..., 3, 3): the column of the largest element of 4 q q^T (Shepperd
    1978)."""
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


def slerp(begin: NdArray, end: NdArray, share: Any) -> NdArray:
    """Unit quaternions (..., 4) on the shorter arc between two (Shoemake 1985)."""
    cosine = np.sum(begin * end, axis=-1, keepdims=True)
    angle = np.arccos(np.minimum(np.abs(cosine), 1))
    near = angle < 1e-6
    sine = np.sin(np.where(near, 1, angle))
    first = np.where(near, 1 - share, np.sin((1 - share) * angle) / sine)
    second = np.where(near, share, np.sin(share * angle) / sine)
    out = first * begin + np.where(cosine < 0, -second, second) * end
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))
