"""UsdGeomMesh to the arrays of a mesh. Needs pxr."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd, UsdGeom

from .._wire.arrays import NdArray
from .context import Context
from .model import Look
from .polygons import triangles
from .primvars import Corners, Spread, fitted, joined, spread, weld

if TYPE_CHECKING:
    from ..scene.patches import Geometry


def geometry(
    context: Context, mesh: Any, subsets: Sequence[NdArray | None], looks: Sequence[Look]
) -> tuple[Geometry, NdArray] | None:
    """The arrays of a mesh whose parts are subsets of its faces, and the point of each vertex;
    None: it has nothing to show."""
    points = np.asarray(context.value(mesh.GetPointsAttr()) or (), dtype="f8").reshape(-1, 3)
    corners = _corners(context, mesh, points)
    if corners is None or not len(corners.points):
        context.note(mesh, "a mesh without faces, or whose faces name points it lacks, is left out")
        return None
    parts = _parts(corners.faces, subsets)
    columns = _columns(context, mesh, corners, parts, looks)
    normals = _normals(context, mesh, corners, points)
    if normals is not None:
        columns["normals"] = normals
    first, vertex = weld(corners.points, list(columns.values()))
    out: Geometry = {"indices": vertex.reshape(-1, 3).astype("<u4")}
    for name, column in columns.items():
        out[name] = column.values[column.which[first]]  # type: ignore[literal-required]
    if len(subsets) > 1:
        out["parts"] = parts[::3].astype("<u4")
    _put_positions(context, mesh, out, (points, corners.points[first]))
    return out, corners.points[first]


def _corners(context: Context, mesh: Any, points: NdArray) -> Corners | None:
    counts = np.asarray(context.value(mesh.GetFaceVertexCountsAttr()) or (), dtype=int)
    indices = np.asarray(context.value(mesh.GetFaceVertexIndicesAttr()) or (), dtype=int)
    fits = len(indices) and counts.sum() == len(indices) and counts.min() >= 0
    if not fits or not 0 <= indices.min() <= indices.max() < len(points):
        return None
    if not np.isfinite(points).all():
        return None
    slots, faces = triangles(points, counts, indices)
    kept = ~np.isin(faces, np.asarray(context.value(mesh.GetHoleIndicesAttr()) or (), dtype=int))
    slots, faces = slots[kept], faces[kept]
    if context.value(mesh.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
        slots = slots[:, ::-1]
    return Corners(indices[slots.ravel()], slots.ravel(), np.repeat(faces, 3))


def _parts(faces: NdArray, subsets: Sequence[NdArray | None]) -> NdArray:
    """(C,) the part of each corner; 0 is of faces that no subset has."""
    out = np.zeros(int(faces.max(initial=0)) + 1, int)
    for part, subset in enumerate(subsets):
        if subset is not None:
            out[subset[(subset >= 0) & (subset < len(out))]] = part
    return out[faces]


def _columns(
    context: Context, mesh: Any, corners: Corners, parts: NdArray, looks: Sequence[Look]
) -> dict[str, Spread]:
    """uvs, uvs1 and colors, each from the primvar that the look of the corner's part reads."""
    prim = mesh.GetPrim()
    out = {}
    for place, name in enumerate(("uvs", "uvs1")):
        read = [look.primvars[place] if place < len(look.primvars) else "" for look in looks]
        if any(read):
            found = [spread(context, prim, n, corners) if n else None for n in read]
            for n, one in zip(read, found):
                if n and one is None:
                    context.note(prim, f"its material reads the primvar {n}, which it lacks")
            out[name] = joined(found, parts, np.zeros(2, "f4"))
    if any(look.colors for look in looks):
        out["colors"] = _colors(context, prim, corners, parts, looks)
    return out


def _colors(
    context: Context, prim: Any, corners: Corners, parts: NdArray, looks: Sequence[Look]
) -> Spread:
    color = spread(context, prim, "displayColor", corners)
    opacity = spread(context, prim, "displayOpacity", corners)
    if opacity is not None:
        color = _with_alpha(color, opacity)
    width = 3 if opacity is None else 4
    shown = [color if look.colors else None for look in looks]
    return joined(shown, parts, np.ones(width, "f4"))


def _with_alpha(color: Spread | None, opacity: Spread) -> Spread:
    """(C, 4) colours, a value a corner."""
    rgb = np.full((len(opacity.which), 3), 0.18, "f4")
    if color is not None:
        rgb = color.values[color.which][:, :3]
    rgba = np.column_stack([rgb, opacity.values[opacity.which][:, :1]])
    return Spread(np.clip(rgba, 0, 1), np.arange(len(rgba)))


# ---------------------------------------------------------------- normals and positions


def _normals(context: Context, mesh: Any, corners: Corners, points: NdArray) -> Spread | None:
    """Authored normals; smooth ones of a subdivision surface's cage; None: flat."""
    prim = mesh.GetPrim()
    found = spread(context, prim, "normals", corners)
    if found is None and context.value(mesh.GetNormalsAttr()):
        what = ("normals", mesh.GetNormalsInterpolation())
        found = fitted(context, prim, what, (context.value(mesh.GetNormalsAttr()), None), corners)
    scheme = context.value(mesh.GetSubdivisionSchemeAttr())
    if scheme != UsdGeom.Tokens.none and found is None:
        context.note(prim, f"{scheme} is not subdivided: its cage is shown, with smooth normals")
        found = Spread(_smooth(points, corners.points), corners.points)
    if found is None or found.values.shape[1] != 3:
        return None
    length = np.linalg.norm(found.values, axis=1, keepdims=True)
    if (length == 0).any():
        context.note(prim, "some of its normals have no length; flat faces are shown")
        return None
    return Spread((found.values / length).astype("f4"), found.which)


def _smooth(points: NdArray, corners: NdArray) -> NdArray:
    """(V, 3) means of the normals of the triangles about each point, by area."""
    a, b, c = (points[corners[i::3]] for i in range(3))
    face = np.cross(b - a, c - a)
    sums = np.zeros_like(points)
    for i in range(3):
        np.add.at(sums, corners[i::3], face)
    sums[np.linalg.norm(sums, axis=1) == 0] = (0, 0, 1)  # of points that no triangle has
    return sums


def _put_positions(context: Context, mesh: Any, out: Geometry, at: tuple[NdArray, NdArray]) -> None:
    """(V, 3), or (K, V, 3) at times."""
    points, vertices = at
    attribute = mesh.GetPointsAttr()
    out["positions"] = points[vertices].astype("f4")
    if attribute.GetNumTimeSamples() < 2:
        return
    codes = context.codes(attribute.GetTimeSamples(), steps=False)
    if not codes:
        context.note(mesh, 'its points move, and are taken as at one time: give times="all"')
        return
    moved = [np.asarray(attribute.Get(Usd.TimeCode(code)) or (), dtype="f4") for code in codes]
    if any(one.shape != points.shape for one in moved) or not all(
        np.isfinite(one).all() for one in moved
    ):
        context.note(mesh, "the number of its points changes; taken as at one time")
        return
    out["positions"] = np.stack([one[vertices] for one in moved])
    out["times"] = [context.seconds(code) for code in codes]
    if out.pop("normals", None) is not None:
        out["normals"] = np.stack([_of_vertices(one, out["indices"]) for one in out["positions"]])


def _of_vertices(positions: NdArray, indices: NdArray) -> NdArray:
    """(V, 3) smooth normals of a mesh that moves; its own are of one time only."""
    sums = _smooth(positions.astype("f8"), indices.ravel())
    return np.asarray(sums / np.linalg.norm(sums, axis=1, keepdims=True), dtype="f4")
