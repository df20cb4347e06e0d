"""The requested subdivision of a UsdGeomMesh. Needs pxr."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from .._wire.arrays import NdArray
from .context import Context
from .subdivision import Cage, Refinement, Sharp

_FACES = 20_000_000  # of one mesh, at most
_SKEL = ("primvars:skel:jointIndices", "skel:blendShapes")


def refinement(
    context: Context, mesh: Any, points: int, faces: tuple[NdArray, NdArray]
) -> Refinement | None:
    """None: its faces are shown as they are; where it should be smooth, that is noted."""
    levels, scheme = context.options.subdivision, context.value(mesh.GetSubdivisionSchemeAttr())
    if scheme == UsdGeom.Tokens.none:
        return None
    why = _why_not(mesh, scheme, levels, faces)
    if why:
        context.note(mesh, f"{scheme} is not subdivided{why}: its cage is shown")
        return None
    counts, indices = faces
    return Refinement(Cage(points, counts, indices, _sharp(context, mesh, points, indices)), levels)


def _why_not(mesh: Any, scheme: Any, levels: int, faces: tuple[NdArray, NdArray]) -> str:
    """ "": it is subdivided."""
    if levels == 0:
        return " (give subdivision=)"
    if scheme != UsdGeom.Tokens.catmullClark:
        return ", as only catmullClark is"
    if any(mesh.GetPrim().GetAttribute(name).HasAuthoredValue() for name in _SKEL):
        return " where it has a skin"
    if faces[0].min() < 3:
        return " where faces have less than 3 corners"
    if len(faces[1]) * 4 ** (levels - 1) > _FACES:
        return f" to more than {_FACES} faces"
    return ""


def _sharp(context: Context, mesh: Any, points: int, indices: NdArray) -> Sharp:
    """Creases and corners; a sharpness of 10 and above is infinite."""
    corners = np.zeros(points)
    if context.value(mesh.GetInterpolateBoundaryAttr()) == UsdGeom.Tokens.edgeAndCorner:
        corners[np.bincount(indices, minlength=points) == 1] = np.inf
    places = _whole(context, mesh.GetCornerIndicesAttr())
    values = _numbers(context, mesh.GetCornerSharpnessesAttr())
    if len(places) == len(values) and (
        not len(places) or 0 <= places.min() <= places.max() < points
    ):
        corners[places] = np.maximum(corners[places], values)
    edges, sharpness = _creases(context, mesh, points)
    return Sharp(edges, sharpness, corners)


def _creases(context: Context, mesh: Any, points: int) -> tuple[NdArray, NdArray]:
    """(E, 2) edges and (E,) sharpness; one value a crease or one an edge."""
    lengths = _whole(context, mesh.GetCreaseLengthsAttr())
    along = _whole(context, mesh.GetCreaseIndicesAttr())
    values = _numbers(context, mesh.GetCreaseSharpnessesAttr())
    none = np.zeros((0, 2), int), np.zeros(0)
    if not len(lengths) or lengths.min() < 2 or lengths.sum() != len(along):
        return none
    if len(values) == len(lengths):
        values = np.repeat(values, lengths - 1)
    ends = np.cumsum(lengths) - 1
    edges = np.delete(np.stack([along, np.roll(along, -1)], axis=-1), ends, axis=0)
    if len(values) != len(edges) or not 0 <= along.min() <= along.max() < points:
        context.note(mesh, "its creases do not fit it; they are left out")
        return none
    return edges, values


def _whole(context: Context, attribute: Any) -> NdArray:
    return np.asarray(context.value(attribute) or (), dtype=int)


def _numbers(context: Context, attribute: Any) -> NdArray:
    found = np.asarray(context.value(attribute) or (), dtype="f8")
    return np.where(found >= 10, np.inf, np.nan_to_num(np.maximum(found, 0)))
