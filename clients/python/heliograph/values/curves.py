"""Splines as the round curves of a mesh: strands of segments that follow them closely."""

from __future__ import annotations

from typing import Any, TypedDict

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument

_MOST_PIECES = 256  # of a span of a spline

# Row i: how much of t^i each of the four points of a span counts.
_BASES: dict[str, NdArray] = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], "f8"),
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], "f8") / 6,
    "catmull_rom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], "f8")
    / 2,
}


class Curves(TypedDict):
    """Keywords of edit.mesh() for curves."""

    positions: NdArray  #: (V, 3), or (K, V, 3), metres
    curves: NdArray  #: (S,) points of each strand
    radii: NdArray  #: (V,) metres


def smooth_curves(
    positions: Any,
    curves: Any,
    radii: Any,
    *,
    basis: str = "catmull_rom",
    tolerance: float | None = None,
) -> Curves:
    """Cubic splines as strands of round segments, for edit.mesh(**...).

    positions: (P, 3) control points in metres, or (K, P, 3) at times. curves: (S,) control points
    of each spline. radii: (P,) metres, or one number. basis: as in USD's BasisCurves, not closed:
    "bezier" (3 n + 1 points), "bspline" (4 and more; it begins and ends beside its points) or
    "catmull_rom" (2 and more, through all; beyond its ends the points go on straight).
    tolerance: metres that no segment's axis is farther from its spline, in any key; default a
    quarter of a spline's least radius. A span becomes 256 segments at most.
    """
    counts = np.asarray(curves, dtype="i8").reshape(-1)
    control = _control(positions, counts, radii)
    _check(counts, basis)
    firsts = np.cumsum(counts) - counts
    within = np.minimum.reduceat(control[0, :, 3], firsts) / 4
    if tolerance is not None:
        if not tolerance > 0:
            raise InvalidArgument(f"tolerance: is {tolerance}; give metres > 0", field="tolerance")
        within = np.full(len(counts), float(tolerance))
    if basis == "catmull_rom":
        control, counts = _lengthened(control, counts)
    spans, of_strand = _spans(control, counts, 3 if basis == "bezier" else 1)
    powers = np.einsum("ij,ksjc->ksic", _BASES[basis], spans)
    points, made = _cut(powers, of_strand, within)
    least = np.minimum.reduceat(control[0, :, 3], np.cumsum(counts) - counts)
    widths = np.maximum(points[0, :, 3], np.repeat(least, made))
    found = points[..., :3].astype("<f4")
    return {
        "positions": found if np.ndim(positions) == 3 else found[0],
        "curves": made.astype("<u4"),
        "radii": widths.astype("<f4"),
    }


def _control(positions: Any, counts: NdArray, radii: Any) -> NdArray:
    """(K, P, 4): the radius is a fourth coordinate."""
    points = np.asarray(positions, dtype="f8")
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise InvalidArgument(
            f"positions: needs (P, 3) or (K, P, 3), has shape {points.shape}", field="positions"
        )
    keyed = points if points.ndim == 3 else points[None]
    if counts.sum() != keyed.shape[1]:
        raise InvalidArgument(
            f"curves: sums to {counts.sum()} points; positions has {keyed.shape[1]}",
            field="curves",
        )
    widths = np.asarray(radii, dtype="f8")
    if widths.shape not in ((), (keyed.shape[1],)) or not (widths > 0).all():
        raise InvalidArgument(
            "radii: needs metres > 0, one number or one for each point", field="radii"
        )
    widths = np.broadcast_to(widths, keyed.shape[:2])
    return np.concatenate([keyed, widths[..., None]], axis=2)


def _check(counts: NdArray, basis: str) -> None:
    if basis not in _BASES:
        raise InvalidArgument(
            f"basis: one of {', '.join(sorted(_BASES))}, not {basis!r}", field="basis"
        )
    if len(counts) == 0:
        raise InvalidArgument(
            "curves: is empty; give the points of 1 spline or more", field="curves"
        )
    least, step = {"bezier": (4, 3), "bspline": (4, 1), "catmull_rom": (2, 1)}[basis]
    for i in np.flatnonzero((counts < least) | ((counts - least) % step != 0))[:1]:
        more = ", + 3 n" if step == 3 else " or more"
        raise InvalidArgument(
            f"curves[{i}]: is {counts[i]}; a {basis} spline has {least}{more} points",
            field=f"curves[{i}]",
        )


def _lengthened(control: NdArray, counts: NdArray) -> tuple[NdArray, NdArray]:
    """With a point before and after each spline, which goes straight on, as wide as there."""
    ends = np.cumsum(counts)
    firsts = ends - counts
    before = 2 * control[:, firsts] - control[:, firsts + 1]
    after = 2 * control[:, ends - 1] - control[:, ends - 2]
    before[..., 3], after[..., 3] = control[:, firsts, 3], control[:, ends - 1, 3]
    longer = np.insert(control, ends, after, axis=1)
    places = firsts + np.arange(len(counts))
    return np.insert(longer, places, before, axis=1), counts + 2


def _spans(control: NdArray, counts: NdArray, step: int) -> tuple[NdArray, NdArray]:
    """(K, N, 4, 4) the points of each cubic, and (N,) whose spline it is a span of."""
    many = (counts - 1) // 3 if step == 3 else counts - 3
    of_strand = np.repeat(np.arange(len(counts)), many)
    number = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
    starts = (np.cumsum(counts) - counts)[of_strand] + step * number
    return control[:, starts[:, None] + np.arange(4)], of_strand


def _cut(powers: NdArray, of_strand: NdArray, within: NdArray) -> tuple[NdArray, NdArray]:
    """(K, V, 4) points of the strands, and (S,) how many each has.

    powers: (K, N, 4, 4), coefficients of t^i of each span. A chord over 1 / n of a cubic is left by
    its greatest second derivative / (8 n^2) at most; that derivative is linear in t.
    Source: Filip, Magedson and Markot 1986, "Surface Algorithms Using Bounds on Derivatives",
    CAGD 3(4).
    """
    bends = [2 * powers[:, :, 2, :3] + 6 * t * powers[:, :, 3, :3] for t in (0.0, 1.0)]
    bend = np.linalg.norm(bends, axis=-1).max(axis=(0, 1))
    pieces = np.ceil(np.sqrt(bend / (8 * within[of_strand]))).clip(1, _MOST_PIECES).astype("i8")
    span = np.repeat(np.arange(len(pieces)), pieces)
    t = (np.arange(len(span)) - (np.cumsum(pieces) - pieces)[span] + 1) / pieces[span]
    own = powers[:, span]
    points = own[:, :, 0] + t[:, None] * (
        own[:, :, 1] + t[:, None] * (own[:, :, 2] + t[:, None] * own[:, :, 3])
    )
    made = np.bincount(of_strand, weights=pieces, minlength=len(within)).astype("i8")
    begins = np.searchsorted(of_strand, np.arange(len(within)))
    places = np.cumsum(made) - made
    return np.insert(points, places, powers[:, begins, 0], axis=1), made + 1
