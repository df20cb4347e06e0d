"""Surface: arrays of a mesh, and the ways to make one: grids, lathes, polygons, extrusions."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

TURN = 2 * math.pi


class Surface(NamedTuple):
    """positions, normals: (V, 3). uvs: (V, 2). indices: (F, 3), counter-clockwise outside."""

    positions: Any
    normals: Any
    uvs: Any
    indices: Any

    def flipped(self) -> Surface:
        """Surface seen from the other side: normals and winding reversed."""
        return self._replace(normals=-self.normals, indices=self.indices[:, ::-1])

    def placed(self, rotation: Any, offset: Any) -> Surface:
        """Turned by a (3, 3), then moved."""
        turn = np.asarray(rotation, dtype=float)
        positions = self.positions @ turn.T + np.asarray(offset, dtype=float)
        return self._replace(positions=positions, normals=self.normals @ turn.T)


def merged(parts: list[Surface]) -> Surface:
    """Joins the parts into one surface, in their order."""
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    return Surface(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uvs for part in parts]),
        np.concatenate([part.indices + start for part, start in zip(parts, starts)]),
    )


def steps(count: int, name: str = "segments") -> Any:
    """count + 1 numbers from 0 to 1."""
    if int(count) != count or count < 1:
        raise RuntimeError(f"{name}: {count} is no whole number above 0")
    return np.linspace(0, 1, int(count) + 1)


def uv_grid(columns: int, rows: int, names: tuple[str, str] = ("segments",) * 2) -> Any:
    """u and v, (rows + 1, columns + 1) each."""
    return np.meshgrid(steps(columns, names[0]), steps(rows, names[1]))


def of_grid(positions: Any, normals: Any, uv: Any) -> Surface:
    """Quads, two triangles each; the outside is along du x dv. positions: (rows, columns, 3)."""
    rows, columns = positions.shape[0] - 1, positions.shape[1] - 1
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    indices = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    normals = np.broadcast_to(normals, positions.shape)
    return Surface(
        positions.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack(uv, axis=-1).reshape(-1, 2),
        indices,
    )


class Arc(NamedTuple):
    """Arc about +Z: radians from +X towards +Y."""

    slices: int
    start: float = 0.0
    sweep: float = TURN


def lathe(profile: Any, outward: Any, arc: Arc, rise: float = 0.0) -> Surface:
    """A profile (M, 2) of radius and height, from below to above, turned about +Z. outward: its
    normals (M, 2). rise: how much higher the end is than the start."""
    u, v = np.meshgrid(steps(arc.slices, "slices"), np.linspace(0, 1, len(profile)))
    angle = arc.start + u * arc.sweep
    around = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    normals = around * outward[:, None, :1] + up * outward[:, None, 1:]
    positions = around * profile[:, None, :1] + up * profile[:, None, 1:]
    positions = positions + up * (rise * (u - 0.5))[..., None]
    return of_grid(positions, normals, (u, v))


def line_profile(a: Any, b: Any, segments: int) -> tuple[Any, Any]:
    """Points and normals of a straight profile from a to b."""
    t = steps(segments)[:, None]
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-300)
    return a + (b - a) * t, np.broadcast_to((along[1], -along[0]), (len(t), 2))


def arc_profile(
    center: Any, radius: float, angles: tuple[float, float], segments: int
) -> tuple[Any, Any]:
    """Points and normals of an arc; angles from +radius towards +height."""
    angle = angles[0] + steps(segments) * (angles[1] - angles[0])
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(center, dtype=float) + radius * outward, outward


def disk(radius: float, inner: float, rings: int, arc: Arc) -> Surface:
    """A ring in the plane z = 0 that faces +Z; v runs inwards."""
    u, v = uv_grid(arc.slices, rings, ("slices", "rings"))
    angle, r = arc.start + u * arc.sweep, radius + v * (inner - radius)
    positions = np.stack([r * np.cos(angle), r * np.sin(angle), np.zeros_like(r)], axis=-1)
    flat = 0.5 + 0.5 * positions / radius
    return of_grid(positions, np.array([0.0, 0.0, 1.0]), (flat[..., 0], flat[..., 1]))


def plane(size: Any, segments: Any) -> Surface:
    """A rectangle that faces +Z; size: halves of its sides."""
    u, v = uv_grid(segments[0], segments[1])
    positions = np.stack([(2 * u - 1) * size[0], (2 * v - 1) * size[1], np.zeros_like(u)], axis=-1)
    return of_grid(positions, np.array([0.0, 0.0, 1.0]), (u, v))


def triangle(corners: Any, segments: int) -> Surface:
    """Flat, with segments along each side: (s + 1)(s + 2) / 2 vertices."""
    n = len(steps(segments)) - 1
    corners = np.asarray(corners, dtype=float)
    cells = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)], dtype=float) / n
    weights = np.column_stack([1 - cells.sum(axis=1), cells[:, 1], cells[:, 0]])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    length = np.linalg.norm(normal)
    if length == 0:
        raise RuntimeError("a triangle needs three corners that are not on one line")
    at = {cell: k for k, cell in enumerate((i, j) for i in range(n + 1) for j in range(n + 1 - i))}
    faces = [(at[i, j], at[i, j + 1], at[i + 1, j]) for i in range(n) for j in range(n - i)]
    faces += [
        (at[i, j + 1], at[i + 1, j + 1], at[i + 1, j]) for i in range(n) for j in range(n - i - 1)
    ]
    normals = np.tile(normal / length, (len(weights), 1))
    return Surface(weights @ corners, normals, weights[:, 1:], np.array(faces))


def polygon(corners: Any, segments: int, rings: int) -> Surface:
    """A flat convex polygon, (K, 3) counter-clockwise: a centre, and rings about it."""
    corners = np.asarray(corners, dtype=float)
    if len(corners) < 3:
        raise RuntimeError("vertices: a polygon has at least 3")
    t = steps(segments)[:-1, None]
    rim = np.concatenate([a + (b - a) * t for a, b in zip(corners, np.roll(corners, -1, axis=0))])
    center = corners.mean(axis=0)
    shrink = 1 - steps(rings, "rings")[:-1]
    around = center + shrink[:, None, None] * (rim - center)
    count = len(rim)
    first = np.arange(count)
    second = (first + 1) % count
    faces = [np.stack([first, second, np.full(count, len(shrink) * count)], 1)]
    faces[0][:, :2] += (len(shrink) - 1) * count
    for ring in range(len(shrink) - 1):
        a, b = ring * count + first, ring * count + second
        faces += [np.stack([a, b, b + count], 1), np.stack([a, b + count, a + count], 1)]
    positions = np.concatenate([around.reshape(-1, 3), center[None]])
    normal = np.cross(corners[0] - center, corners[1] - center)
    normal = normal / np.linalg.norm(normal)
    across = corners[0] - center
    extent = np.linalg.norm(across)
    axes = np.stack([across / extent, np.cross(normal, across) / extent])
    uvs = 0.5 + 0.5 * ((positions - center) @ axes.T) / extent
    normals = np.tile(normal, (len(positions), 1))
    return Surface(positions, normals, uvs, np.concatenate(faces))


def extruded(shape: Any, outward: Any, path: Any, frames: Any) -> Surface:
    """A shape (K, 2) along a path (M, 3). outward: its normals (K, 2). frames: (M, 2, 3), where the
    shape's axes point; their cross product is along the path."""
    positions = path[:, None] + np.einsum("kc,mcx->mkx", shape, frames)
    normals = np.einsum("kc,mcx->mkx", outward, frames)
    u, v = np.meshgrid(np.linspace(0, 1, len(shape)), np.linspace(0, 1, len(path)))
    return of_grid(positions, normals, (u, v))


def carried_frames(path: Any) -> Any:
    """(M, 2, 3) frames across a path that turn as little as they can; Bishop 1975."""
    path = np.asarray(path, dtype=float)
    edges = np.diff(path, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    if len(path) < 2 or lengths.min() == 0:
        raise RuntimeError("a path needs at least two points, and no two equal ones in a row")
    edges /= lengths[:, None]
    along = np.concatenate([edges[:1], edges[:-1] + edges[1:], edges[-1:]])
    norms = np.linalg.norm(along, axis=1)
    along[norms < 1e-9] = edges[0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    helper = (0.0, 0.0, 1.0) if abs(along[0][2]) < 0.9 else (1.0, 0.0, 0.0)
    x = np.cross(helper, along[0])
    frames = []
    for tangent in along:
        x = x - tangent * (x @ tangent)
        x = x / np.linalg.norm(x)
        frames.append((x, np.cross(tangent, x)))
    return np.array(frames)
