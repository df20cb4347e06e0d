"""A second opinion on planes and labels: a brute-force tracer in numpy float64, which shares no
code with the renderer. Conventions are those of proto/heliograph/v1/types.proto."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Thing:
    """One entity that shows a mesh, with what its labels should be."""

    positions: np.ndarray  # (V, 3)
    triangles: np.ndarray  # (F, 3)
    world: np.ndarray  # (4, 4)
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None
    parts: np.ndarray | None = None  # (F,)
    label: int = 0
    category: int = 0
    first_part: int = 1
    opaque: np.ndarray = field(default_factory=lambda: np.ones(0, bool))

    def world_positions(self) -> np.ndarray:
        return self.positions @ self.world[:3, :3].T + self.world[:3, 3]


@dataclass
class Hits:
    """Closest hits of N rays; thing is -1 where nothing was hit."""

    t: np.ndarray
    thing: np.ndarray
    triangle: np.ndarray
    u: np.ndarray
    v: np.ndarray
    margin: (
        np.ndarray
    )  # distance to the nearest triangle edge in barycentric units: small = ambiguous


def pixel_rays(k: np.ndarray, width: int, height: int) -> np.ndarray:
    """Directions (H, W, 3) by the pixel centres (decision 037), OpenCV camera frame, z = 1."""
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    x, y = x + 0.83 * 2**-21 * width, y + 0.57 * 2**-21 * width
    return np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones_like(x)], -1)


def trace(things: list[Thing], origin: np.ndarray, directions: np.ndarray) -> Hits:
    """Closest hits of rays from one origin; t is in units of the directions' length.

    Moeller & Trumbore 1997, without culling."""
    d = directions.reshape(-1, 3)
    n = len(d)
    hits = Hits(*(np.full(n, x) for x in (np.inf, -1, -1, 0.0, 0.0, 0.0)))
    hits.thing, hits.triangle = hits.thing.astype(int), hits.triangle.astype(int)
    for index, thing in enumerate(things):
        p = thing.world_positions()
        for f, (a, b, c) in enumerate(p[thing.triangles]):
            e1, e2 = b - a, c - a
            h = np.cross(d, e2)
            det = h @ e1
            with np.errstate(divide="ignore", invalid="ignore"):
                s = origin - a
                u = (h @ s) / det
                q = np.cross(s, e1)
                v = (d @ q) / det
                t = (e2 @ q) / det
                margin = np.minimum(np.minimum(u, v), 1 - u - v)
            near = (margin > -1e-3) & (margin < 1e-3) & (t > 1e-6)
            inside = (margin >= 0) & (t > 1e-6) & (t < hits.t)
            for name, value in (("t", t), ("u", u), ("v", v), ("margin", margin)):
                getattr(hits, name)[inside] = value[inside]
            hits.thing[inside], hits.triangle[inside] = index, f
            hits.margin[near & (t <= hits.t * (1 + 1e-6))] = 0
    return hits


def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices on the unit sphere and counter-clockwise triangles."""
    g = (1 + 5**0.5) / 2
    v = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    v += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    f = [
        (0, 11, 5),
        (0, 5, 1),
        (0, 1, 7),
        (0, 7, 10),
        (0, 10, 11),
        (1, 5, 9),
        (5, 11, 4),
        (11, 10, 2),
    ]
    f += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5)]
    f += [(2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    points = [np.array(x, float) / np.linalg.norm(x) for x in v]
    faces = f
    for _ in range(level):
        middle: dict[tuple[int, int], int] = {}

        def mid(a: int, b: int) -> int:
            key = (min(a, b), max(a, b))
            if key not in middle:
                m = points[a] + points[b]
                points.append(m / np.linalg.norm(m))
                middle[key] = len(points) - 1
            return middle[key]

        finer = []
        for a, b, c in faces:
            ab, bc, ca = mid(a, b), mid(b, c), mid(c, a)
            finer += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = finer
    return np.array(points), np.array(faces)


def cube() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners of a cube of side 2, its triangles, and two parts of six triangles each."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    parts = (np.arange(12) >= 6).astype(np.uint32)
    return corners, faces, parts


def rotation(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    """(3, 3), Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def pose(translation=(0, 0, 0), r: np.ndarray | None = None, scale=1.0) -> np.ndarray:
    m = np.eye(4)
    m[:3, :3] = (np.eye(3) if r is None else r) @ np.diag(np.broadcast_to(scale, 3).astype(float))
    m[:3, 3] = translation
    return m


CV_FROM_GL = np.diag([1.0, -1, -1, 1])


def look_at_cv(eye, target, up=(0, 0, 1)) -> np.ndarray:
    """camera_from_world in the OpenCV frame, (4, 4)."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    r = np.stack([x, np.cross(z, x), z])
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = r, -r @ eye
    return m


def extent(mask: np.ndarray) -> list[int]:
    """Half-open pixel box of a mask: x0, y0, x1, y1; zeros when it is empty."""
    y, x = np.nonzero(mask)
    return [x.min(), y.min(), x.max() + 1, y.max() + 1] if len(x) else [0, 0, 0, 0]


def at_hits(
    hits: Hits, index: int, thing: Any, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where thing `index` was hit: those hits' numbers, and vertex values interpolated there."""
    mine = np.flatnonzero(hits.thing == index)
    corner = values[thing.triangles[hits.triangle[mine]]]
    u, v = hits.u[mine, None], hits.v[mine, None]
    return mine, corner[:, 0] * (1 - u - v) + corner[:, 1] * u + corner[:, 2] * v


def facing_normals(hits: Hits, things: list, directions: np.ndarray) -> np.ndarray:
    """Unit normals of the triangles that were hit, towards where the rays come from; else 0."""
    out = np.zeros((len(directions), 3))
    for index, thing in enumerate(things):
        mine = np.flatnonzero(hits.thing == index)
        corners = thing.world_positions()[thing.triangles[hits.triangle[mine]]]
        a, b, c = np.moveaxis(corners, 1, 0)
        out[mine] = np.cross(b - a, c - a)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)
    return np.where((out * directions).sum(1, keepdims=True) > 0, -out, out)
