"""Planes as files have them: Middlebury's .flo, KITTI's flow and disparity, depth in steps."""

from __future__ import annotations

import struct

import numpy as np

from ..._wire.arrays import NdArray
from ...image import png

UNKNOWN_FLOW = 1e10  # Middlebury's code takes values above 1e9 for unknown


def flo(flow: NdArray, valid: NdArray) -> bytes:
    """Middlebury's .flo (Baker et al. 2011; flowIO.cpp): little-endian float32 202021.25, int32
    width, int32 height, then rows of u, v from the top. flow: (H, W, 2) pixels, u right, v down.
    valid: (H, W); other pixels are 1e10."""
    height, width = valid.shape
    data = np.where(valid[..., None] != 0, flow, np.float32(UNKNOWN_FLOW)).astype("<f4")
    return struct.pack("<fii", 202021.25, width, height) + data.tobytes()


def kitti_flow(flow: NdArray, valid: NdArray) -> bytes:
    """KITTI's flow PNG (Menze & Geiger 2015, readme): RGB of uint16, u * 64 + 2^15,
    v * 64 + 2^15, valid. flow: (H, W, 2) pixels; valid: (H, W). Values outside [-512, 511.98] are
    not valid; pixels that are not valid are 0."""
    raw = np.rint(flow.astype(np.float64) * 64.0 + 32768.0)
    holds = (valid != 0) & ((raw >= 0) & (raw <= 65535)).all(axis=2)
    out = np.zeros((*valid.shape, 3), np.uint16)
    out[holds, :2] = raw[holds].astype(np.uint16)
    out[..., 2] = holds
    return png.encode(out)


def kitti_disparity(disparity: NdArray, valid: NdArray) -> bytes:
    """KITTI's disparity PNG: grey uint16, disparity * 256; 0: invalid. disparity: (H, W) pixels.
    Values outside [1/256, 255.996] are invalid."""
    raw = np.rint(disparity.astype(np.float64) * 256.0)
    holds = (valid != 0) & (raw >= 1) & (raw <= 65535)
    return png.encode(np.where(holds, raw, 0).astype(np.uint16))


def depth_steps(depth: NdArray, step: float) -> NdArray:
    """(H, W) uint16: round(depth / step), both in metres; 0 where nothing is hit, and 65535 where
    it is farther than 65535 steps."""
    steps = np.rint(np.where(np.isfinite(depth), depth, 0.0).astype(np.float64) / step)
    return np.asarray(np.minimum(steps, 65535).astype(np.uint16))
