"""Polygons of masks, along the edges of pixels. Used by the YOLO writer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray

_RIGHT, _DOWN, _LEFT, _UP = range(4)
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def outlines(mask: Any) -> list[NdArray]:
    """The closed outlines of a mask (H, W) bool: (N, 2) int64 each, the corners (x, y) in raster
    coordinates, where pixel (x, y) covers [x, x + 1) x [y, y + 1).

    With y down they go clockwise around pixels and counter-clockwise around holes, so that the sum
    of their signed areas is the number of pixels. Pixels that share a corner alone are apart.
    """
    leaving = _edges(np.asarray(mask, dtype=bool))
    found = []
    while leaving:
        start = next(iter(leaving))
        found.append(_walk(leaving, start))
    return found


def _edges(mask: NdArray) -> dict[tuple[int, int], list[int]]:
    """Directions of the unit edges that leave each corner, the mask on their right."""
    padded = np.pad(mask, 1)
    inner = padded[1:-1, 1:-1]
    sides = (
        (_RIGHT, padded[:-2, 1:-1], 0, 0),  # the upper edge of a pixel, from its upper left corner
        (_DOWN, padded[1:-1, 2:], 1, 0),
        (_LEFT, padded[2:, 1:-1], 1, 1),
        (_UP, padded[1:-1, :-2], 0, 1),
    )
    leaving: dict[tuple[int, int], list[int]] = {}
    for direction, neighbour, dx, dy in sides:
        ys, xs = np.nonzero(inner & ~neighbour)
        for corner in zip((xs + dx).tolist(), (ys + dy).tolist()):
            leaving.setdefault(corner, []).append(direction)
    return leaving


def _walk(leaving: dict[tuple[int, int], list[int]], start: tuple[int, int]) -> NdArray:
    """Takes the edges of one outline out of `leaving`; its corners."""
    first = direction = leaving[start][0]
    at, before, corners = start, -1, []
    while True:
        if direction != before:
            corners.append(at)
        leaving[at].remove(direction)
        if not leaving[at]:
            del leaving[at]
        at, before = (at[0] + _STEPS[direction][0], at[1] + _STEPS[direction][1]), direction
        choices = leaving.get(at, [])
        right = (before + 1) % 4  # where four pixels meet crosswise: stay at this one
        if at == start and (right == first or not choices):
            break
        direction = right if right in choices else choices[0]
    if before == first:  # the start is in the middle of an edge
        del corners[0]
    return np.array(corners, dtype=np.int64)


def area_of(outline: NdArray) -> float:
    """Signed area: positive for clockwise with y down."""
    x, y = outline[:, 0], outline[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def joined(parts: Sequence[NdArray]) -> NdArray:
    """Joins outlines into one, (N, 2): each is reached from the nearest corner of those before it,
    and left by the same way, so that the area between is none. Holes stay holes."""
    ordered = sorted(parts, key=area_of, reverse=True)
    whole = ordered[0]
    for part in ordered[1:]:
        distances = np.sum((whole - part[0]) ** 2, axis=1)
        i = int(np.argmin(distances))
        whole = np.concatenate([whole[: i + 1], part, part[:1], whole[i:]])
    return whole
