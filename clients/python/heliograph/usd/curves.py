"""UsdGeomBasisCurves to the round curves of a mesh. Needs pxr."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Usd, UsdGeom

from .._wire.arrays import NdArray
from ..values.curves import smooth_curves
from .context import Context

if TYPE_CHECKING:
    from ..scene.patches import Geometry

_WIDTH = 1.0  # where a prim has none, as its schema's renderers take it
# Rows: the points of a Bezier span by the four points of a span of the basis.
_BEZIERS = {
    "bspline": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]], "f8") / 6,
    "catmullRom": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]], "f8") / 6,
}


def geometry(context: Context, prim: Any) -> Geometry | None:
    """Strands of its curves; None: it is left out (noted)."""
    curves = UsdGeom.BasisCurves(prim)
    counts = np.asarray(context.value(curves.GetCurveVertexCountsAttr()) or (), dtype="i8")
    points = _points(context, curves)
    if points is None or not len(counts) or counts.sum() != points.shape[1] or counts.min() < 2:
        context.note(prim, "curves without points, or whose counts do not fit them, are left out")
        return None
    radii = _radii(context, curves, counts)
    if radii is None:
        return None
    if context.value(curves.GetNormalsAttr()) is not None:
        context.note(prim, "its normals make ribbons of it: round curves are shown")
    control = np.concatenate(
        [points, np.broadcast_to(radii[None, :, None], (*points.shape[:2], 1))], axis=2
    )
    out = _strands(context, curves, np.split(control, np.cumsum(counts)[:-1], axis=1))
    if out is None:
        return None
    if len(points) == 1:
        out["positions"] = out["positions"][0]
    else:
        out["times"] = [context.seconds(code) for code in _codes(context, curves)]
    _put_colors(context, prim, out)
    return out


def _codes(context: Context, curves: Any) -> list[float]:
    return context.codes(curves.GetPointsAttr().GetTimeSamples(), steps=False)


def _points(context: Context, curves: Any) -> NdArray | None:
    """(K, P, 3); None: there are none, or they are not finite."""
    attribute = curves.GetPointsAttr()
    still = np.asarray(context.value(attribute) or (), dtype="f8").reshape(-1, 3)
    moved = [still]
    codes = _codes(context, curves)
    if len(codes) > 1:
        keyed = [np.asarray(attribute.Get(Usd.TimeCode(code)) or (), dtype="f8") for code in codes]
        if all(one.shape == still.shape for one in keyed):
            moved = keyed
        else:
            context.note(curves, "the number of its points changes; taken as at one time")
    elif attribute.GetNumTimeSamples() > 1:
        context.note(curves, 'its points move, and are taken as at one time: give times="all"')
    found = np.stack(moved)
    return found if found.shape[1] and np.isfinite(found).all() else None


def _radii(context: Context, curves: Any, counts: NdArray) -> NdArray | None:
    """(P,) half the widths at the control points."""
    found = np.ravel(np.asarray(context.value(curves.GetWidthsAttr()) or (), dtype="f8"))
    if not len(found):
        context.note(curves, f"it has no widths: {_WIDTH:g} taken")
        found = np.array([_WIDTH])
    if not np.isfinite(found).all() or not (found > 0).all():
        context.note(curves, "widths that are not above 0: it is left out")
        return None
    if len(found) == 1:
        return np.full(counts.sum(), 0.5 * found[0])
    if len(found) == counts.sum():
        return 0.5 * found
    if len(found) == len(counts):
        return np.repeat(0.5 * found, counts)
    return 0.5 * _varying(context, curves, counts, found)


def _varying(context: Context, curves: Any, counts: NdArray, found: NdArray) -> NdArray:
    """Values at the ends of spans, spread evenly over the control points."""
    spans = [_span_count(context, curves, int(count)) for count in counts]
    if len(found) != sum(spans) + len(spans):
        context.note(curves, "its widths do not fit its points: the first one taken")
        return np.full(counts.sum(), found[0])
    out, start = [], 0
    for count, many in zip(counts, spans):
        own = found[start : start + many + 1]
        out.append(np.interp(np.linspace(0, many, count), np.arange(many + 1), own))
        start += many + 1
    return np.concatenate(out)


def _span_count(context: Context, curves: Any, count: int) -> int:
    if context.value(curves.GetTypeAttr()) == UsdGeom.Tokens.linear:
        return count - 1
    if context.value(curves.GetBasisAttr()) == UsdGeom.Tokens.bezier:
        return (count - 1) // 3
    return count - (1 if context.value(curves.GetWrapAttr()) == UsdGeom.Tokens.pinned else 3)


def _strands(context: Context, curves: Any, each: list[NdArray]) -> Geometry | None:
    """positions (K, V, 3), curves and radii; None: they are left out (noted)."""
    linear = context.value(curves.GetTypeAttr()) == UsdGeom.Tokens.linear
    basis = str(context.value(curves.GetBasisAttr()) or "bezier")
    wrap = str(context.value(curves.GetWrapAttr()) or "nonperiodic")
    if not linear and basis not in ("bezier", *_BEZIERS):
        context.note(curves, f"curves of the basis {basis} are left out")
        return None
    if wrap == "periodic":
        closing = 1 if linear or basis == "bezier" else 3
        each = [np.concatenate([one, one[:, :closing]], axis=1) for one in each]
    if linear:
        whole = np.concatenate(each, axis=1)
        return _geometry(whole, np.array([one.shape[1] for one in each]))
    if wrap == "pinned" and basis != "bezier":
        each = [_pinned(one) for one in each]
    if basis != "bezier":
        each = [_as_beziers(one, _BEZIERS[basis]) for one in each]
    if any(one.shape[1] < 4 or one.shape[1] % 3 != 1 for one in each):
        context.note(curves, f"cubic curves with too few points for {basis} are left out")
        return None
    whole = np.concatenate(each, axis=1)
    made = smooth_curves(
        whole[..., :3], [one.shape[1] for one in each], whole[0, :, 3], basis="bezier"
    )
    return {
        "positions": made["positions"],
        "curves": made["curves"],
        "radii": made["radii"],
    }


def _geometry(whole: NdArray, counts: NdArray) -> Geometry:
    return {
        "positions": whole[..., :3].astype("<f4"),
        "curves": counts.astype("<u4"),
        "radii": whole[0, :, 3].astype("<f4"),
    }


def _pinned(one: NdArray) -> NdArray:
    """With a point before and after it, so that it begins and ends at its own."""
    before, after = 2 * one[:, :1] - one[:, 1:2], 2 * one[:, -1:] - one[:, -2:-1]
    before[..., 3], after[..., 3] = one[:, :1, 3], one[:, -1:, 3]
    return np.concatenate([before, one, after], axis=1)


def _as_beziers(one: NdArray, basis: NdArray) -> NdArray:
    """(K, 3 n + 1, 4): the same cubics by the points of Bezier spans; radii stay above 0."""
    if one.shape[1] < 4:
        return one[:, :0]
    spans = np.stack([one[:, i : i + 4] for i in range(one.shape[1] - 3)], axis=1)
    beziers = np.einsum("ij,ksjc->ksic", basis, spans)
    beziers[..., 3] = np.maximum(beziers[..., 3], one[..., 3].min())
    first = beziers[:, :1, 0]
    rest = beziers[:, :, 1:].reshape(one.shape[0], -1, 4)
    return np.concatenate([first, rest], axis=1)


def _put_colors(context: Context, prim: Any, out: Geometry) -> None:
    """colors by strand, or by point of linear curves, of a displayColor that varies."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    found = None if not primvar else primvar.ComputeFlattened(context.time)
    if found is None or len(found) < 2:
        return
    colors = np.clip(np.asarray(found, dtype="f4"), 0, 1)
    counts = np.asarray(out["curves"])
    if len(colors) == len(counts):
        out["colors"] = np.repeat(colors, counts, axis=0)
    elif len(colors) == len(out["radii"]):
        out["colors"] = colors
    else:
        context.note(prim, "its displayColor varies along splines: white taken")
