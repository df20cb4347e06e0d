"""Joints that vertices of skins follow. Used by readers of models."""

from __future__ import annotations

import numpy as np

from .._wire.arrays import NdArray

INFLUENCES = 4  #: joints that a vertex follows at most


def strongest(joints: NdArray, weights: NdArray) -> tuple[NdArray, NdArray]:
    """(V, 4) uint16 joints and float32 weights: the largest of each vertex, which then sum to 1.

    joints, weights: (V, K). A vertex without weights follows its first joint.
    """
    order = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    shape = len(weights), INFLUENCES
    kept_joints, kept = np.zeros(shape, "<u2"), np.zeros(shape, "<f4")
    width = order.shape[1]
    kept[:, :width] = np.maximum(np.take_along_axis(weights, order, 1), 0)
    kept_joints[:, :width] = np.take_along_axis(joints, order, 1) * (kept[:, :width] > 0)
    kept[kept.sum(axis=1) == 0, 0] = 1
    return kept_joints, kept / kept.sum(axis=1, keepdims=True)
