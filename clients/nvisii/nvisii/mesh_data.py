"""Arrays of a mesh: checked, joined, with normals and tangents where none are given."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .checks import array
from .tessellation.surface import Surface


class Arrays(NamedTuple):
    """positions, normals: (V, 3) float32. uvs: (V, 2) float32. indices: (F, 3) uint32. colors,
    tangents: (V, 4) float32; tangents None: along growing u."""

    positions: Any
    normals: Any
    uvs: Any
    indices: Any
    colors: Any
    tangents: Any = None
    has_colors: bool = False

    def geometry(self) -> dict[str, Any]:
        """The keyword arguments of Edits.mesh."""
        out = {
            "positions": self.positions,
            "normals": self.normals,
            "uvs": self.uvs,
            "indices": self.indices,
        }
        if self.tangents is not None:
            out["tangents"] = self.tangents
        if self.has_colors:
            out["colors"] = self.colors
        return out


def of_surface(surface: Surface) -> Arrays:
    """White, without tangents of its own."""
    positions, normals, uvs = (_packed(column) for column in surface[:3])
    if not all(np.isfinite(column).all() for column in (positions, normals, uvs)):
        raise RuntimeError("a mesh of these sizes has no surface: one is 0, or too large")
    return Arrays(
        positions,
        normals,
        uvs,
        np.ascontiguousarray(surface.indices, dtype="<u4"),
        np.ones((len(positions), 4), "<f4"),
    )


def rows(values: Any, dimensions: int, allowed: tuple[int, ...], name: str) -> Any:
    """(N, dimensions) float32 of a flat list or array; empty: None."""
    flat = array(name, values, "<f4")
    if dimensions not in allowed:
        choices = " or ".join(map(str, allowed))
        raise RuntimeError(f"{name}: have {choices} dimensions, not {dimensions}")
    if flat.size == 0:
        return None
    if flat.size % dimensions:
        raise RuntimeError(f"{name}: {flat.size} numbers are no multiple of {dimensions}")
    return flat.reshape(-1, dimensions)


def of_data(
    positions: Any, normals: Any, tangents: Any, colors: Any, texcoords: Any, indices: Any
) -> Arrays:
    """Arrays of a mesh from rows; None: not given. Without indices each three vertices are a
    triangle, and equal vertices are joined."""
    if positions is None:
        raise RuntimeError("positions: a mesh needs some")
    count = len(positions)
    for name, given in (
        ("normals", normals),
        ("tangents", tangents),
        ("colors", colors),
        ("texcoords", texcoords),
    ):
        if given is not None and len(given) != count:
            raise RuntimeError(f"{name}: {len(given)} for {count} positions; give as many")
    columns = [positions[:, :3], normals, tangents, colors, texcoords]
    faces = _faces(indices, count)
    if faces is None:
        given = [column for column in columns if column is not None]
        kept, inverse = _joined(np.concatenate(given, axis=1))
        faces = inverse.reshape(-1, 3).astype("<u4")
        columns = [None if column is None else column[kept] for column in columns]
    points, normals, tangents, colors, texcoords = columns
    points = np.ascontiguousarray(points, dtype="<f4")
    if normals is None:
        normals = smooth_normals(points, faces)
    white = np.ones((len(points), 4), "<f4")
    return Arrays(
        points,
        np.ascontiguousarray(normals[:, :3], dtype="<f4"),
        np.zeros((len(points), 2), "<f4") if texcoords is None else _packed(texcoords),
        faces,
        white if colors is None else _wide(colors),
        None if tangents is None else _wide(tangents),
        colors is not None,
    )


def _packed(array: Any) -> Any:
    return np.ascontiguousarray(array, dtype="<f4")


def _wide(array: Any) -> Any:
    """(N, 4): a fourth column of 1 where there are three."""
    out = np.ones((len(array), 4), "<f4")
    out[:, : array.shape[1]] = array
    return out


def _faces(indices: Any, count: int) -> Any:
    flat = array("indices", indices)
    if flat.size == 0:
        if count % 3:
            raise RuntimeError(f"positions: {count} without indices are no whole triangles")
        return None
    if flat.size % 3:
        raise RuntimeError(f"indices: {flat.size} are no whole triangles")
    whole = flat.astype(np.int64)
    if whole.min() < 0 or whole.max() >= count:
        raise RuntimeError(f"indices: must be in [0, {count}), one is {whole.max()}")
    return whole.reshape(-1, 3).astype("<u4")


def _joined(rows: Any) -> tuple[Any, Any]:
    """(indices of the first of each different row, for each row which of these), in order."""
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[inverse.reshape(-1)]


def smooth_normals(positions: Any, indices: Any) -> Any:
    """(V, 3) float32: normals of triangles times angle and area (after Thuermer and Wuethrich
    1998, who weigh by the angle)."""
    p = positions.astype(float)
    a, b, c = (p[indices[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    out = np.zeros_like(p)
    for k, (here, left, right) in enumerate(((a, b, c), (b, c, a), (c, a, b))):
        u, v = left - here, right - here
        lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        cosine = np.clip((u * v).sum(axis=1) / np.maximum(lengths, 1e-300), -1, 1)
        np.add.at(out, indices[:, k], normals * np.arccos(cosine)[:, None])
    lengths = np.linalg.norm(out, axis=1, keepdims=True)
    out = np.where(lengths > 0, out / np.maximum(lengths, 1e-300), (0.0, 0.0, 1.0))
    return out.astype("<f4")


def tangents_of(arrays: Arrays) -> Any:
    """(V, 4) float32: those given, or along growing u (Lengyel 2001), w the bitangent's sign."""
    if arrays.tangents is not None:
        return arrays.tangents
    p, uv, n = (x.astype(float) for x in (arrays.positions, arrays.uvs, arrays.normals))
    i = arrays.indices
    e1, e2 = p[i[:, 1]] - p[i[:, 0]], p[i[:, 2]] - p[i[:, 0]]
    d1, d2 = uv[i[:, 1]] - uv[i[:, 0]], uv[i[:, 2]] - uv[i[:, 0]]
    area = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
    scale = np.where(area != 0, 1 / np.where(area != 0, area, 1), 0)[:, None]
    along_u = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) * scale
    along_v = (e2 * d1[:, :1] - e1 * d2[:, :1]) * scale
    u, v = np.zeros_like(p), np.zeros_like(p)
    for k in range(3):
        np.add.at(u, i[:, k], along_u)
        np.add.at(v, i[:, k], along_v)
    u -= n * (u * n).sum(axis=1, keepdims=True)
    lengths = np.linalg.norm(u, axis=1, keepdims=True)
    helper = np.where(abs(n[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    across = np.cross(helper, n)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    u = np.where(lengths > 1e-12, u / np.maximum(lengths, 1e-300), across)
    sign = np.where((np.cross(n, u) * v).sum(axis=1) < 0, -1.0, 1.0)
    return np.column_stack([u, sign]).astype("<f4")
