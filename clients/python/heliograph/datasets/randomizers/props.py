"""Shapes made of numbers, for scenes without models. Used by distractors and the generators."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..._wire.arrays import NdArray

if TYPE_CHECKING:
    from ...scene.patches import Geometry

Generator = np.random.Generator


def random_shape(rng: Generator, segments: int = 40) -> Geometry:
    """A closed mesh whose box is at most 1 m long, about the origin, with normals and coordinates:
    a superellipsoid, a superellipsoid's torus, a turned body, a pebble, a star prism or a knot."""
    makers = (_superellipsoid, _supertorus, _turned, _pebble, _star, _knot)
    geometry = makers[int(rng.integers(len(makers)))](rng, segments)
    points = np.asarray(geometry["positions"], dtype="f8")
    low, high = points.min(axis=0), points.max(axis=0)
    points = (points - 0.5 * (low + high)) / (high - low).max()
    return {**geometry, "positions": points.astype("<f4")}


def surface(points: NdArray) -> Geometry:
    """Quads of a closed grid (rows, columns, 3) as triangles that face outwards, with smooth
    normals; u along the columns, v along the rows."""
    rows, columns = points.shape[0] - 1, points.shape[1] - 1
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    indices = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    flat = points.reshape(-1, 3)
    corners = flat[indices]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    kept = area > 1e-9 * area.max()
    if np.einsum("fk,fk->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0:
        indices, cross = indices[:, ::-1], -cross
    normals = np.zeros_like(flat)
    np.add.at(normals, indices[kept].ravel(), np.repeat(cross[kept], 3, axis=0))
    normals = _shared(flat, normals)
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    return {
        "positions": flat.astype("<f4"),
        "indices": indices[kept].astype("<u4"),
        "normals": normals.astype("<f4"),
        "uvs": np.stack([u, v], axis=-1).reshape(-1, 2).astype("<f4"),
    }


def _shared(points: NdArray, normals: NdArray) -> NdArray:
    """Unit normals, the same for vertices in the same place: across seams and at poles."""
    scale = float(np.ptp(points)) or 1.0
    _, index = np.unique(np.round(points / scale, 6), axis=0, return_inverse=True)
    index = index.reshape(-1)
    sums = np.zeros((index.max() + 1, 3))
    np.add.at(sums, index, normals)
    out = sums[index]
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30))


def turned(profile: NdArray, segments: int) -> Geometry:
    """A body of revolution about +Z: profile (P, 2) radius and height, from below along the
    outside; its ends are on the axis, or it is closed."""
    phi = np.linspace(0, 2 * math.pi, segments + 1)
    r, z = profile[:, :1], np.broadcast_to(profile[:, 1:], (len(profile), segments + 1))
    return surface(np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1))


def rounded(profile: NdArray, radius: float, steps: int = 4) -> NdArray:
    """A polygon (P, 2) whose inner corners are arcs of about that radius; ends stay."""
    out = [profile[:1]]
    for before, corner, after in zip(profile, profile[1:], profile[2:]):
        ends = []
        for other in (before, after):
            way = other - corner
            length = max(float(np.linalg.norm(way)), 1e-12)
            ends.append(corner + way * min(0.45, radius / length))
        t = np.linspace(0, 1, steps + 1)[:, None]
        out.append((1 - t) ** 2 * ends[0] + 2 * t * (1 - t) * corner + t * t * ends[1])
    return np.concatenate([*out, profile[-1:]])


def _power(x: NdArray, exponent: float) -> NdArray:
    return np.asarray(np.sign(x) * np.abs(x) ** exponent)


def _angles(segments: int, rows: int) -> tuple[NdArray, NdArray]:
    """Around 0 .. 2 pi, along -pi / 2 .. pi / 2."""
    return np.meshgrid(
        np.linspace(0, 2 * math.pi, segments + 1), np.linspace(-math.pi / 2, math.pi / 2, rows + 1)
    )


def _superellipsoid(rng: Generator, segments: int) -> Geometry:
    """Barr 1981, "Superquadrics and Angle-Preserving Transformations"."""
    phi, theta = _angles(segments, segments // 2)
    e1, e2 = rng.choice([0.15, 0.3, 1.0, 1.0, 2.2], 2)
    size = rng.uniform(0.35, 1.0, 3)
    ring = _power(np.cos(theta), e1)
    points = [ring * _power(np.cos(phi), e2), ring * _power(np.sin(phi), e2)]
    return surface(np.stack([*points, _power(np.sin(theta), e1)], axis=-1) * size)


def _supertorus(rng: Generator, segments: int) -> Geometry:
    phi, theta = np.meshgrid(
        np.linspace(0, 2 * math.pi, segments + 1),
        np.linspace(0, 2 * math.pi, segments // 2 + 1),
    )
    e1, e2 = rng.choice([0.3, 1.0, 1.0], 2)
    ring = 1 + rng.uniform(0.2, 0.55) * _power(np.cos(theta), e1)
    points = [ring * _power(np.cos(phi), e2), ring * _power(np.sin(phi), e2)]
    height = rng.uniform(0.2, 0.7) * _power(np.sin(theta), e1)
    return surface(np.stack([*points, height], axis=-1))


def _turned(rng: Generator, segments: int) -> Geometry:
    heights = np.sort(rng.uniform(0, rng.uniform(0.8, 2.5), 5))
    radii = rng.uniform(0.25, 0.8, 5)
    profile = np.column_stack([[0, *radii, 0], [heights[0], *heights, heights[-1]]])
    return turned(rounded(profile, 0.2), segments)


def _pebble(rng: Generator, segments: int) -> Geometry:
    phi, theta = _angles(segments, segments // 2)
    way = np.stack(
        [np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], axis=-1
    )
    radius = np.ones(phi.shape)
    for frequency in (1.0, 2.0, 4.0):
        waves = rng.normal(0, frequency, (4, 3))
        radius += 0.12 / frequency * np.sin(way @ waves.T * 2 + rng.uniform(0, 6.3, 4)).sum(axis=-1)
    return surface(way * np.maximum(0.3, radius)[..., None] * rng.uniform(0.6, 1.0, 3))


def _star(rng: Generator, segments: int) -> Geometry:
    """A prism over a star or a polygon, flat as a coin or tall as a rod, with soft edges."""
    corners, inner = int(rng.integers(3, 9)), rng.uniform(0.45, 1.0)
    phi = np.linspace(0, 2 * math.pi, corners * max(2, segments // corners // 2) * 2 + 1)
    wave = np.abs((phi * corners / (2 * math.pi)) % 1 - 0.5) * 2
    outline = inner + (1 - inner) * wave
    height = rng.uniform(0.15, 1.6)
    profile = rounded(np.array([(0, 0), (1, 0), (1, height), (0, height)]), 0.08)
    r, z = profile[:, :1] * outline, np.repeat(profile[:, 1:], len(phi), axis=1)
    return surface(np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1))


def _knot(rng: Generator, segments: int) -> Geometry:
    """A tube along a (2, q) torus knot; q = 1 is a bent ring."""
    q, tube = int(rng.choice([1, 3, 5])), rng.uniform(0.12, 0.28)
    along = np.linspace(0, 2 * math.pi, 4 * segments + 1)
    ring = 1 + 0.45 * np.cos(q * along)
    path = np.stack(
        [ring * np.cos(2 * along), ring * np.sin(2 * along), 0.55 * np.sin(q * along)], axis=-1
    )
    if q == 1:
        path = np.stack([np.cos(along), np.sin(along), 0.4 * np.sin(2 * along)], axis=-1)
    tangent = np.roll(path[:-1], -1, axis=0) - np.roll(path[:-1], 1, axis=0)
    tangent = np.concatenate([tangent, tangent[:1]])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.cross(tangent, np.cross(path, tangent))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    around = np.linspace(0, 2 * math.pi, segments // 2 + 1)[:, None]
    offset = np.cos(around)[..., None] * second + np.sin(around)[..., None] * first
    return surface((path + tube * offset)[:, ::-1])
