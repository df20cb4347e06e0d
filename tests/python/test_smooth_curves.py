"""Splines as strands: against the splines themselves."""

import heliograph as hg
import numpy as np
import pytest

TURNS = np.linspace(0, 2 * np.pi, 9)
HELIX = np.stack([np.cos(TURNS), np.sin(TURNS), 0.1 * TURNS], -1)


def spline(points, basis, count=400):
    """Points of one spline, by de Boor's and Catmull and Rom's weights."""
    if basis == "catmull_rom":
        points = np.vstack([2 * points[0] - points[1], points, 2 * points[-1] - points[-2]])
    step = 3 if basis == "bezier" else 1
    t = np.linspace(0, 1, count)[:, None]
    out = []
    for i in range(0, len(points) - 3, step):
        a, b, c, d = points[i : i + 4]
        if basis == "bezier":
            one = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b
            out.append(one + 3 * t**2 * (1 - t) * c + t**3 * d)
        elif basis == "bspline":
            one = (1 - t) ** 3 * a + (3 * t**3 - 6 * t**2 + 4) * b
            out.append((one + (-3 * t**3 + 3 * t**2 + 3 * t + 1) * c + t**3 * d) / 6)
        else:
            first, second = (c - a) / 2, (d - b) / 2
            one = (2 * t**3 - 3 * t**2 + 1) * b + (t**3 - 2 * t**2 + t) * first
            out.append(one + (3 * t**2 - 2 * t**3) * c + (t**3 - t**2) * second)
    return np.concatenate(out)


def distances(points, strand):
    """Distances of points from a polyline."""
    a, b = strand[:-1, None], strand[1:, None]
    ab = b - a
    u = np.clip(((points - a) * ab).sum(-1) / (ab**2).sum(-1), 0, 1)
    return np.linalg.norm(points - a - u[..., None] * ab, axis=-1).min(0)


@pytest.mark.parametrize("basis", ["catmull_rom", "bspline", "bezier"])
@pytest.mark.parametrize("tolerance", [0.1, 0.01, 0.001])
def test_strands_are_within_the_tolerance(basis, tolerance):
    points = HELIX[:7]
    made = hg.smooth_curves(points, [7], 0.05, basis=basis, tolerance=tolerance)
    strand = made["positions"].astype("f8")
    off = distances(spline(points, basis), strand)
    assert off.max() < tolerance + 1e-6
    assert made["curves"].tolist() == [len(strand)] == [len(made["radii"])]


def test_finer_tolerances_make_more_segments_and_ends_stay():
    counts = [
        len(hg.smooth_curves(HELIX, [9], 0.05, tolerance=t)["radii"]) for t in (0.1, 0.01, 0.001)
    ]
    assert counts[0] < counts[1] < counts[2] < 9 * 256
    made = hg.smooth_curves(HELIX, [9], 0.05)
    np.testing.assert_allclose(made["positions"][[0, -1]], HELIX[[0, -1]], atol=1e-6)


def test_many_splines_are_as_each_alone():
    both = np.concatenate([HELIX, HELIX[:5] + (3, 0, 0)])
    radii = np.linspace(0.05, 0.01, 14)
    made = hg.smooth_curves(both, [9, 5], radii)
    one = hg.smooth_curves(HELIX, [9], radii[:9])
    other = hg.smooth_curves(both[9:], [5], radii[9:])
    for name in made:
        np.testing.assert_allclose(made[name], np.concatenate([one[name], other[name]]), atol=1e-7)
    assert made["radii"].min() >= 0.01 - 1e-9


def test_keys_have_the_same_points():
    keyed = np.stack([HELIX, HELIX * (2, 1, 1)])
    made = hg.smooth_curves(keyed, [9], 0.05, tolerance=0.01)
    assert made["positions"].shape == (2, made["curves"].sum(), 3)
    for key, points in zip(made["positions"].astype("f8"), keyed, strict=True):
        assert distances(spline(points, "catmull_rom"), key).max() < 0.01 + 1e-6


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"positions": np.zeros((9, 2))}, "positions"),
        ({"curves": [8]}, "curves"),
        ({"curves": [1, 8]}, "curves[0]"),
        ({"curves": []}, "curves"),
        ({"radii": 0.0}, "radii"),
        ({"radii": [0.1] * 8}, "radii"),
        ({"radii": float("nan")}, "radii"),
        ({"basis": "hermite"}, "basis"),
        ({"basis": "bezier"}, "curves[0]"),
        ({"tolerance": 0.0}, "tolerance"),
    ],
)
def test_refused(given, field):
    with pytest.raises(hg.InvalidArgument) as raised:
        hg.smooth_curves(**{"positions": HELIX, "curves": [9], "radii": 0.1, **given})
    assert raised.value.field == field
