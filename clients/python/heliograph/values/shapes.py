"""Bundled meshes, as the keyword arguments of edit.mesh(): edit.mesh("ball", **hg.shapes.sphere()).

Metres, centred on the origin, +Z up, with normals and texture coordinates.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .._wire.arrays import NdArray

if TYPE_CHECKING:
    from ..scene.patches import Geometry


def plane(size: float = 1.0) -> Geometry:
    """A square in the xy plane that faces +Z; uv once over it."""
    h = 0.5 * size
    return {
        "positions": np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]], dtype="<f4"),
        "indices": np.array([[0, 1, 2], [0, 2, 3]], dtype="<u4"),
        "normals": np.tile(np.array([0, 0, 1], dtype="<f4"), (4, 1)),
        "uvs": np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype="<f4"),
    }


def cube(size: float = 1.0) -> Geometry:
    """A cube with flat faces; uv once over each face."""
    face = plane(size)
    corners = np.asarray(face["positions"]) + np.array([0, 0, 0.5 * size])
    turns = [
        ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
        ((0, -1, 0), (0, 0, 1), (-1, 0, 0)),
        ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ]
    sides = [np.array(turn, dtype="f4") for turn in turns]
    return {
        "positions": np.concatenate([corners @ side for side in sides]).astype("<f4"),
        "indices": np.concatenate([np.asarray(face["indices"]) + 4 * i for i in range(6)]),
        "normals": np.concatenate([np.tile(side[2], (4, 1)) for side in sides]).astype("<f4"),
        "uvs": np.tile(np.asarray(face["uvs"]), (6, 1)),
    }


def sphere(radius: float = 0.5, segments: int = 64) -> Geometry:
    """A sphere of `segments` by `segments / 2` quads; u around +Z, v from the lower pole."""
    around, along = _grid(segments, segments // 2)
    phi, theta = 2 * math.pi * around, math.pi * along
    normals = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)], axis=-1
    )
    return grid_surface(radius * normals, normals, (around, along))


def torus(radius: float = 0.35, tube: float = 0.15, segments: int = 96) -> Geometry:
    """A torus around +Z: `radius` to the middle of the tube of radius `tube`."""
    around, along = _grid(segments, segments // 2)
    phi, theta = 2 * math.pi * around, 2 * math.pi * along
    outward = np.stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    normals = outward * np.cos(theta)[..., None] + up * np.sin(theta)[..., None]
    return grid_surface(radius * outward + tube * normals, normals, (around, along))


def cylinder(radius: float = 0.5, height: float = 1.0, segments: int = 64) -> Geometry:
    """A closed cylinder along +Z with sharp rims."""
    around, along = _grid(segments, 1)
    phi = 2 * math.pi * around
    outward = np.stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)], axis=-1)
    body = radius * outward
    body[..., 2] = (along - 0.5) * height
    side = grid_surface(body, outward, (around, along))
    parts = [side, _disc(radius, 0.5 * height, segments), _disc(radius, -0.5 * height, segments)]
    starts = np.cumsum([0] + [len(np.asarray(part["positions"])) for part in parts])
    return {
        "positions": np.concatenate([np.asarray(p["positions"]) for p in parts]),
        "indices": np.concatenate(
            [np.asarray(p["indices"]) + np.uint32(s) for p, s in zip(parts, starts)]
        ).astype("<u4"),
        "normals": np.concatenate([np.asarray(p["normals"]) for p in parts]),
        "uvs": np.concatenate([np.asarray(p["uvs"]) for p in parts]),
    }


def capsule(radius: float = 0.25, length: float = 0.5, segments: int = 64) -> Geometry:
    """A cylinder of `length` along +Z between two halves of a sphere; u around +Z, v from the lower
    pole, even along the surface."""
    quarter = np.linspace(0, 0.5 * math.pi, segments // 4 + 1)
    theta = np.concatenate([quarter, quarter + 0.5 * math.pi])[:, None]  # from the lower pole
    lift = length * np.repeat([0.0, 1.0], len(quarter))[:, None]
    around, _ = _grid(segments, len(theta) - 1)
    phi = 2 * math.pi * around
    normals = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta) + 0 * phi], -1
    )
    positions = radius * normals
    positions[..., 2] += lift - 0.5 * length
    along = (radius * theta + lift) / (math.pi * radius + length)
    return grid_surface(positions, normals, (around, along + 0 * phi))


def _disc(radius: float, z: float, segments: int) -> Geometry:
    """A disc at height z that faces away from the origin."""
    phi = 2 * math.pi * np.arange(segments) / segments
    rim = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    flat = np.concatenate([rim, [[0.0, 0.0]]])
    positions = np.column_stack([radius * flat, np.full(segments + 1, z)]).astype("<f4")
    first = np.arange(segments)
    second = (first + 1) % segments
    order = (first, second) if z > 0 else (second, first)
    return {
        "positions": positions,
        "indices": np.column_stack([*order, np.full(segments, segments)]).astype("<u4"),
        "normals": np.tile(np.array([0, 0, math.copysign(1, z)], dtype="<f4"), (segments + 1, 1)),
        "uvs": (0.5 + 0.5 * flat).astype("<f4"),
    }


def _grid(columns: int, rows: int) -> tuple[NdArray, NdArray]:
    """u and v in [0, 1], (rows + 1, columns + 1) each."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    return u, v


def grid_surface(positions: NdArray, normals: NdArray, uv: tuple[NdArray, NdArray]) -> Geometry:
    """Quads of a grid as triangles, without those that a pole makes degenerate."""
    rows, columns = positions.shape[0] - 1, positions.shape[1] - 1
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    indices = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    flat = positions.reshape(-1, 3)
    p, q, r = flat[indices[:, 0]], flat[indices[:, 1]], flat[indices[:, 2]]
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1)
    return {
        "positions": flat.astype("<f4"),
        "indices": indices[area > 1e-9 * area.max()].astype("<u4"),
        "normals": normals.reshape(-1, 3).astype("<f4"),
        "uvs": np.stack(uv, axis=-1).reshape(-1, 2).astype("<f4"),
    }
