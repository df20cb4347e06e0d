"""Masks: run lengths, extents, polygons. Used by the formats' modules.

Run lengths: https://github.com/cocodataset/cocoapi, common/maskApi.c, read from its text.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray


def counts_of_text(text: str) -> NdArray:
    """(N,) run lengths of COCO's compressed text; ValueError when it is none.

    Each number is little-endian groups of five bits plus 48, bit 6 means that more follow, the
    last group's bit 5 is the sign; from the fourth on a number is added to the one two before.
    """
    groups = np.frombuffer(text.encode("latin-1"), np.uint8).astype(np.int64) - 48
    if not len(groups) or (groups < 0).any() or (groups > 63).any():
        raise ValueError(f"{text[:20]!r} has characters that compressed run lengths have not")
    ends = np.flatnonzero(groups & 32 == 0)
    if not len(ends) or ends[-1] != len(groups) - 1:
        raise ValueError("compressed run lengths end within a number")
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends - starts + 1
    shifts = 5 * (np.arange(len(groups)) - np.repeat(starts, lengths))
    counts = np.add.reduceat((groups & 31) << shifts, starts)
    counts -= np.where(groups[ends] & 16, np.left_shift(1, 5 * lengths), 0)
    counts[1::2] = np.cumsum(counts[1::2])
    counts[2::2] = np.cumsum(counts[2::2])
    return np.asarray(counts)


def counts_of(segmentation: dict[str, Any]) -> NdArray:
    """(N,) run lengths of {"size", "counts"}; ValueError when they are none."""
    counts = segmentation["counts"]
    if isinstance(counts, str):
        return counts_of_text(counts)
    if not all(isinstance(count, int) for count in counts):
        raise ValueError("run lengths are whole numbers")
    return np.array(counts, np.int64)


def spans_of(counts: NdArray, size: Sequence[int]) -> NdArray:
    """(N, 2) first pixel and one past the last of each run of ones, pixels counted column by
    column. ValueError when counts do not fill a picture of size (height, width)."""
    if (counts < 0).any() or counts.sum() != size[0] * size[1]:
        raise ValueError(
            f"run lengths sum to {counts.sum()}, and a picture {size[1]}x{size[0]} has "
            f"{size[0] * size[1]} pixels"
        )
    ends = np.cumsum(counts)
    spans = np.column_stack([ends[:-1:2], ends[1::2]])
    return np.asarray(spans[spans[:, 0] < spans[:, 1]])


def box_of_spans(spans: NdArray, height: int) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1, half open, of pixels counted column by column; zeros of none. With the width
    for height: y0, x0, y1, x1 of pixels counted row by row."""
    if not len(spans):
        return 0, 0, 0, 0
    first, last = spans[:, 0], spans[:, 1] - 1
    columns, until = first // height, last // height
    across = bool((columns != until).any())  # over the end of a column to the next one
    y0 = 0 if across else int((first % height).min())
    y1 = height if across else int((last % height).max()) + 1
    return int(columns.min()), y0, int(until.max()) + 1, y1


def mask_of(counts: NdArray, size: Sequence[int]) -> NdArray:
    """(H, W) bool."""
    flat = np.zeros(size[0] * size[1], bool)
    for start, end in spans_of(counts, size):
        flat[start:end] = True
    height, width = size
    return flat.reshape(width, height).T


def extent(mask: NdArray) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1, half open; zeros of an empty mask."""
    columns = np.flatnonzero(mask.any(0))
    rows = np.flatnonzero(mask.any(1))
    if not len(rows):
        return 0, 0, 0, 0
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def polygon_area(points: NdArray) -> float:
    """Area of a polygon of (N, 2) vertices in order (the shoelace formula)."""
    x, y = points[:, 0], points[:, 1]
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def polygon_length(points: NdArray) -> float:
    """The outline of (N, 2) vertices."""
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())
