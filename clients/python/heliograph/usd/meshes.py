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
from .refining import refinement

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
    points = _fine(corners, points)
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
    out["positions"] = points[corners.points[first]].astype("f4")
    _put_motion(context, mesh, out, (corners, corners.points[first]))
    return out, corners.points[first]


def _corners(context: Context, mesh: Any, points: NdArray) -> Corners | None:
    counts = np.asarray(context.value(mesh.GetFaceVertexCountsAttr()) or (), dtype=int)
    indices = np.asarray(context.value(mesh.GetFaceVertexIndicesAttr()) or (), dtype=int)
    fits = len(indices) and counts.sum() == len(indices) and counts.min() >= 0
    if not fits or not 0 <= indices.min() <= indices.max() < len(points):
        return None
    if not np.isfinite(points).all():
        return None
    refined = refinement(context, mesh, len(points), (counts, indices))
    if refined is not None:
        points, indices = refined.at_points(points), refined.indices
        counts = np.full(len(indices) // 4, 4)
    slots, faces = triangles(points, counts, indices)
    faces = faces if refined is None else refined.faces[faces]
    kept = ~np.isin(faces, np.asarray(context.value(mesh.GetHoleIndicesAttr()) or (), dtype=int))
    slots, faces = slots[kept], faces[kept]
    if context.value(mesh.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
        slots = slots[:, ::-1]
    return Corners(indices[slots.ravel()], slots.ravel(), np.repeat(faces, 3), refined)


def _fine(corners: Corners, points: NdArray) -> NdArray:
    """Points of the cage, or of its refinement."""
    return points if corners.refinement is None else corners.refinement.at_points(points)


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
    """(C, 4) colours, one per corner."""
    rgb = np.full((len(opacity.which), 3), 0.18, "f4")
    if color is not None:
        rgb = color.values[color.which][:, :3]
    rgba = np.column_stack([rgb, opacity.values[opacity.which][:, :1]])
    return Spread(np.clip(rgba, 0, 1), np.arange(len(rgba)))


# ---------------------------------------------------------------- normals and positions


def _normals(context: Context, mesh: Any, corners: Corners, points: NdArray) -> Spread | None:
    """Authored normals; smooth ones for subdivided meshes, or meshes meant to be; None: flat."""
    prim = mesh.GetPrim()
    found = None if corners.refinement else _authored(context, mesh, corners)
    is_smooth = context.value(mesh.GetSubdivisionSchemeAttr()) != UsdGeom.Tokens.none
    if is_smooth and found is None:
        found = Spread(_smooth(points, corners.points), corners.points)
    if found is None or found.values.shape[1] != 3:
        return None
    length = np.linalg.norm(found.values, axis=1, keepdims=True)
    if (length == 0).any():
        context.note(prim, "some of its normals have no length; flat faces are shown")
        return None
    return Spread((found.values / length).astype("f4"), found.which)


def _authored(context: Context, mesh: Any, corners: Corners) -> Spread | None:
    """primvars:normals, which come before normals."""
    found = spread(context, mesh.GetPrim(), "normals", corners)
    given = context.value(mesh.GetNormalsAttr())
    if found is not None or given is None:
        return found
    what = ("normals", mesh.GetNormalsInterpolation())
    return fitted(context, mesh.GetPrim(), what, (given, None), corners)


def _smooth(points: NdArray, corners: NdArray) -> NdArray:
    """(V, 3) means of the normals of the triangles about each point, by area."""
    a, b, c = (points[corners[i::3]] for i in range(3))
    face = np.cross(b - a, c - a)
    sums = np.zeros_like(points)
    for i in range(3):
        np.add.at(sums, corners[i::3], face)
    sums[np.linalg.norm(sums, axis=1) == 0] = (0, 0, 1)  # of points that no triangle has
    return sums


def _put_motion(context: Context, mesh: Any, out: Geometry, which: tuple[Corners, NdArray]) -> None:
    """positions (K, V, 3) at times, where the points move."""
    corners, vertices = which
    attribute = mesh.GetPointsAttr()
    if attribute.GetNumTimeSamples() < 2:
        return
    codes = context.codes(attribute.GetTimeSamples(), steps=False)
    if not codes:
        context.note(mesh, 'its points move, and are taken as at one time: give times="all"')
        return
    moved = [np.asarray(attribute.Get(Usd.TimeCode(code)) or (), dtype="f8") for code in codes]
    known = np.asarray(context.value(attribute)).shape
    if any(one.shape != known or not np.isfinite(one).all() for one in moved):
        context.note(mesh, "the number of its points changes; taken as at one time")
        return
    out["positions"] = np.stack([_fine(corners, one)[vertices] for one in moved]).astype("f4")
    out["times"] = [context.seconds(code) for code in codes]
    if out.pop("normals", None) is not None:
        out["normals"] = np.stack([_of_vertices(one, out["indices"]) for one in out["positions"]])


def _of_vertices(positions: NdArray, indices: NdArray) -> NdArray:
    """(V, 3) smooth normals of a mesh that moves; its own are of one time only."""
    sums = _smooth(positions.astype("f8"), indices.ravel())
    return np.asarray(sums / np.linalg.norm(sums, axis=1, keepdims=True), dtype="f4")
