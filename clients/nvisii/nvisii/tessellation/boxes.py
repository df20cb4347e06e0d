"""Boxes, rounded boxes, regular solids, and wires about a box."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from .surface import Arc, Surface, arc_profile, lathe, merged, plane, polygon, triangle

_GOLDEN = (1 + math.sqrt(5)) / 2


def _faces() -> list[tuple[int, Any]]:
    """(axis, (3, 3) rotation that takes +Z to plus or minus that axis), of six faces."""
    out = []
    for axis, sign in itertools.product(range(3), (1, -1)):
        z = np.eye(3)[axis] * sign
        x = np.eye(3)[(axis + 1) % 3]
        out.append((axis, np.stack([x, np.cross(z, x), z], axis=1)))
    return out


def box(size: Any, segments: Any, offset: float = 0.0) -> Surface:
    """Six rectangles; size: halves of the sides. offset: moves each outwards."""
    parts = []
    for axis, turn in _faces():
        first, second = (axis + 1) % 3, (axis + 2) % 3
        face = plane((size[first], size[second]), (segments[first], segments[second]))
        parts.append(face.placed(turn, turn[:, 2] * (size[axis] + offset)))
    return merged(parts)


def rounded_box(radius: float, size: Any, slices: int, segments: Any) -> Surface:
    """A box of half sides `size`, and everything within `radius` of it."""
    parts = [box(size, segments, offset=radius)]
    for axis in range(3):
        turn = np.roll(np.eye(3), axis + 1, axis=0)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for quarter in range(4):
            arc = Arc(slices, quarter * math.pi / 2, math.pi / 2)
            signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))[quarter]
            t = np.linspace(-1, 1, int(segments[axis]) + 1) * size[axis]
            profile = np.stack([np.full_like(t, radius), t], axis=1)
            edge = lathe(profile, np.broadcast_to((1.0, 0.0), profile.shape), arc)
            offset = np.zeros(3)
            offset[first], offset[second] = signs[0] * size[first], signs[1] * size[second]
            parts.append(edge.placed(turn, offset))
    for quarter, upper in itertools.product(range(4), (1, -1)):
        arc = Arc(slices, quarter * math.pi / 2, math.pi / 2)
        angles = (0.0, math.pi / 2) if upper > 0 else (-math.pi / 2, 0.0)
        corner = lathe(*arc_profile((0, 0), radius, angles, slices), arc)
        x, y = ((1, 1), (-1, 1), (-1, -1), (1, -1))[quarter]
        parts.append(corner.placed(np.eye(3), np.array([x, y, upper]) * size))
    return merged(parts)


def icosahedron(radius: float, segments: int) -> Surface:
    """Twenty flat triangles."""
    corners = np.array(
        [p for a, b in itertools.product((-1, 1), (-_GOLDEN, _GOLDEN)) for p in _cyclic(0, a, b)]
    )
    corners *= radius / np.linalg.norm(corners[0])
    side = 2 * radius / math.hypot(1, _GOLDEN)
    parts = []
    for three in itertools.combinations(corners, 3):
        sides = [np.linalg.norm(a - b) for a, b in itertools.combinations(three, 2)]
        if np.allclose(sides, side):
            a, b, c = three
            outside = np.cross(b - a, c - a) @ a > 0
            parts.append(triangle((a, b, c) if outside else (a, c, b), segments))
    return merged(parts)


def _cyclic(a: float, b: float, c: float) -> list[tuple[float, float, float]]:
    return [(a, b, c), (b, c, a), (c, a, b)]


def icosphere(radius: float, segments: int) -> Surface:
    """Icosahedron with every vertex moved to the sphere."""
    return spherified(icosahedron(radius, segments), radius)


def spherified(surface: Surface, radius: float) -> Surface:
    """Moves every vertex to a sphere about the origin."""
    lengths = np.linalg.norm(surface.positions, axis=1, keepdims=True)
    if lengths.min() == 0:
        raise RuntimeError("a vertex at the origin has no place on a sphere")
    outward = surface.positions / lengths
    return surface._replace(positions=outward * radius, normals=outward)


def dodecahedron(radius: float, segments: int, rings: int) -> Surface:
    """Twelve flat pentagons."""
    small = 1 / _GOLDEN
    corners = [np.array(c) for c in itertools.product((-1.0, 1.0), repeat=3)]
    for a, b in itertools.product((-small, small), (-_GOLDEN, _GOLDEN)):
        corners += [np.array(c) for c in _cyclic(0, a, b)]
    points = np.array(corners) * (radius / math.sqrt(3))
    parts = []
    for normal in icosahedron_axes():
        height = points @ normal
        face = points[height > height.max() - 1e-6 * radius]
        spokes = face - face.mean(axis=0)
        around = np.arctan2(spokes @ np.cross(normal, spokes[0]), spokes @ spokes[0])
        parts.append(polygon(face[np.argsort(around)], segments, rings))
    return merged(parts)


def icosahedron_axes() -> Any:
    """(12, 3) unit directions to the faces of the dodecahedron."""
    found = np.array(
        [p for a, b in itertools.product((-1, 1), (-_GOLDEN, _GOLDEN)) for p in _cyclic(0, b, a)]
    )
    return found / np.linalg.norm(found[0])


def wires(low: Any, high: Any, thickness: float) -> Surface:
    """Twelve bars along the edges of a box; thickness: half of a bar's width."""
    middle, half = (high + low) / 2, (high - low) / 2
    parts = []
    for axis in range(3):
        size = np.full(3, thickness)
        size[axis] = half[axis] + thickness
        for a, b in itertools.product((-1, 1), repeat=2):
            offset = middle.copy()
            offset[(axis + 1) % 3] += a * half[(axis + 1) % 3]
            offset[(axis + 2) % 3] += b * half[(axis + 2) % 3]
            parts.append(box(size, (1, 1, 1)).placed(np.eye(3), offset))
    return merged(parts)
