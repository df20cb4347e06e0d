"""Polygons to triangles."""

from __future__ import annotations

import numpy as np

from .._wire.arrays import NdArray

_EARS = 512  # corners up to which a polygon that is not convex is cut by its ears


def triangles(points: NdArray, counts: NdArray, indices: NdArray) -> tuple[NdArray, NdArray]:
    """(T, 3) places in `indices` and (T,) faces of polygons with `counts` corners each.

    Convex polygons, and quads with a corner that points inwards, are fans; others are cut by their
    ears (Meisters 1975).
    """
    starts = np.cumsum(counts) - counts
    slots, faces = [np.zeros((0, 3), int)], [np.zeros(0, int)]
    for corners in np.unique(counts[counts >= 3]).tolist():
        chosen = np.flatnonzero(counts == corners)
        fan, rest = _fans(points[indices[starts[chosen][:, None] + np.arange(corners)]])
        for face in rest.tolist():
            polygon = points[indices[starts[chosen[face]] + np.arange(corners)]]
            fan[face] = _ears(polygon)
        slots.append((starts[chosen][:, None, None] + fan).reshape(-1, 3))
        faces.append(np.repeat(chosen, corners - 2))
    every = np.concatenate(faces)
    order = np.argsort(every, kind="stable")
    return np.concatenate(slots)[order], every[order]


def _fans(polygons: NdArray) -> tuple[NdArray, NdArray]:
    """(N, C - 2, 3) corners of the triangles of (N, C, 3) polygons, and the polygons that need ear
    clipping."""
    count, corners, _ = polygons.shape
    first = np.zeros(count, int)
    rest = np.zeros(0, int)
    if corners > 3:
        inward = _inward(polygons)
        first = inward.argmax(axis=1)
        if corners > 4:
            first[:] = 0
            rest = np.flatnonzero(inward.any(axis=1))
    steps = np.arange(1, corners - 1)
    fan = np.stack([np.zeros_like(steps), steps, steps + 1], axis=-1)
    return (fan[None] + first[:, None, None]) % corners, rest


def _inward(polygons: NdArray) -> NdArray:
    """(N, C) bool: True for a corner that points inwards, seen along the polygon's normal
    (Newell)."""
    ahead = np.roll(polygons, -1, axis=1) - polygons
    turns = np.cross(np.roll(ahead, 1, axis=1), ahead)
    normal = np.cross(polygons, np.roll(polygons, -1, axis=1)).sum(axis=1)
    along = np.einsum("ncx,nx->nc", turns, normal)
    return np.asarray(along < -1e-9 * (normal**2).sum(axis=1)[:, None])


def _ears(polygon: NdArray) -> NdArray:
    """(C - 2, 3) corners of one polygon."""
    flat = _flattened(polygon)
    left = list(range(len(flat)))
    found = []
    while len(left) > 3 and len(polygon) <= _EARS:
        ear = next((i for i in range(len(left)) if _is_ear(flat, left, i)), 0)
        found.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    found += [[left[0], left[i], left[i + 1]] for i in range(1, len(left) - 1)]
    return np.array(found)


def _flattened(polygon: NdArray) -> NdArray:
    """(C, 2) along the axes that its normal is least along, counter-clockwise."""
    normal = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    flat: NdArray = polygon[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return np.asarray(flat * (1, np.sign(normal[axis]) or 1))


def _is_ear(flat: NdArray, left: list[int], i: int) -> bool:
    """True if the triangle at a corner is within the polygon, and no other corner in it."""
    a, b, c = flat[left[i - 1]], flat[left[i]], flat[left[(i + 1) % len(left)]]
    if _side(a, b, c) <= 0:
        return False
    others = flat[[k for k in left if k not in (left[i - 1], left[i], left[(i + 1) % len(left)])]]
    inside = (_side(a, b, others) >= 0) & (_side(b, c, others) >= 0) & (_side(c, a, others) >= 0)
    return not bool(np.any(inside))


def _side(a: NdArray, b: NdArray, p: NdArray) -> NdArray:
    """Above 0 where p lies to the left of the line from a to b."""
    found: NdArray = (b[0] - a[0]) * (p[..., 1] - a[1]) - (b[1] - a[1]) * (p[..., 0] - a[0])
    return found
