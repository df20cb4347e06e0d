"""Primvars at the corners of triangles, and corners to vertices. Needs pxr."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from .._wire.arrays import NdArray
from .context import Context
from .subdivision import Refinement

_REFINED = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying, UsdGeom.Tokens.faceVarying)


@dataclass(frozen=True)
class Corners:
    """C corners of triangles: (C,) places in the points, in faceVertexIndices, and faces. Where
    there is a refinement, places in the points and corners of its quads; faces are the cage's."""

    points: NdArray
    slots: NdArray
    faces: NdArray
    refinement: Refinement | None = None

    def of(self, interpolation: str) -> NdArray:
        """(C,) places in the values of a primvar."""
        if interpolation == UsdGeom.Tokens.uniform:
            return self.faces
        if interpolation == UsdGeom.Tokens.faceVarying:
            return self.slots
        if interpolation == UsdGeom.Tokens.constant:
            return np.zeros_like(self.points)
        return self.points  # vertex, varying


@dataclass(frozen=True)
class Spread:
    """Values (N, W) and which of them each corner has, (C,)."""

    values: NdArray
    which: NdArray


def spread(context: Context, prim: Any, name: str, corners: Corners) -> Spread | None:
    """A primvar of numbers, inherited too; None: there is none, or it does not fit (noted)."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None
    if primvar.ValueMightBeTimeVarying():
        context.note(prim, f"the primvar {name} changes, and is taken as at one time")
    indices = primvar.GetIndices(context.time)
    values = context.value(primvar.GetAttr())
    return fitted(context, prim, (name, primvar.GetInterpolation()), (values, indices), corners)


def fitted(
    context: Context,
    prim: Any,
    what: tuple[str, str],
    given: tuple[Any, Any],
    corners: Corners,
) -> Spread | None:
    """Values and indices of (name, interpolation) at corners; None: they do not fit (noted)."""
    name, interpolation = what
    values, indices = given
    table = np.array(values, dtype="f4")
    table = table.reshape(len(table), -1) if table.ndim else table.reshape(1, 1)
    if corners.refinement is not None and interpolation in _REFINED:
        table, indices = _refined(corners.refinement, interpolation, table, indices), None
    which = corners.of(interpolation)
    if indices is not None and len(indices):
        listed = np.asarray(indices, dtype=int)
        which = listed[which] if not len(which) or which.max() < len(listed) else which + len(table)
    if len(which) and not 0 <= which.min() <= which.max() < len(table):
        context.note(prim, f"the primvar {name} has too few {interpolation} values; left out")
        return None
    if not np.isfinite(table).all():
        context.note(prim, f"the primvar {name} is not finite; left out")
        return None
    return Spread(table, which)


def _refined(refinement: Refinement, interpolation: str, table: NdArray, indices: Any) -> NdArray:
    """Values at the points or corners of the quads; none where there are too few."""
    cage = refinement.cages[0]
    if indices is not None and len(indices):
        table = table[np.clip(np.asarray(indices, dtype=int), 0, len(table) - 1)]
    is_corners = interpolation == UsdGeom.Tokens.faceVarying
    if len(table) != (len(cage.indices) if is_corners else cage.points):
        return table[:0]
    return (refinement.at_corners if is_corners else refinement.at_points)(table)


def joined(spreads: list[Spread | None], parts: NdArray, default: NdArray) -> Spread:
    """Joins spreads into one: each corner takes its part's; the default where that has none."""
    tables, which, start = [default[None]], np.zeros(len(parts), int), 1
    for part, one in enumerate(spreads):
        if one is not None:
            here = parts == part
            which[here] = one.which[here] + start
            tables.append(_wide(one.values, len(default)))
            start += len(one.values)
    return Spread(np.concatenate(tables).astype("f4"), which)


def _wide(values: NdArray, width: int) -> NdArray:
    """(N, width): cut, or filled up with ones."""
    out = np.ones((len(values), width), "f4")
    out[:, : values.shape[1]] = values[:, :width]
    return out


def weld(points: NdArray, spreads: list[Spread]) -> tuple[NdArray, NdArray]:
    """(V,) a corner of each vertex, and (C,) the vertex of each corner: corners at one point with
    equal values are one vertex."""
    key = points.astype(np.int64)
    for one in spreads:
        _, value = np.unique(one.values, axis=0, return_inverse=True)
        ids = value.reshape(-1)[one.which]
        _, key = np.unique(key * (int(ids.max(initial=0)) + 1) + ids, return_inverse=True)
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    return first, vertex.reshape(-1)
