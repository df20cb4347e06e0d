"""Draws of randomizers, against the distributions that they promise. Each chi-square test has
a level of 0.001: of a thousand right implementations one would fail; the seeds are fixed."""

import types

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph.datasets.randomizers import ranges, surface

COUNT = 4000


def chi_square_passes(counts, shares):
    """Pearson's test at level 0.001; the quantile by Wilson and Hilferty (1931)."""
    counts, expected = np.asarray(counts, "f8"), np.sum(counts) * np.asarray(shares, "f8")
    assert expected.min() > 5
    statistic = ((counts - expected) ** 2 / expected).sum()
    k = 2 / (9 * (len(counts) - 1))
    return statistic < (len(counts) - 1) * (1 - k + 3.0902 * np.sqrt(k)) ** 3


def uniform_passes(values, low, high, bins=20):
    values = np.asarray(values)
    assert values.min() >= low and values.max() <= high
    counts, _ = np.histogram(values, bins, (low, high))
    return chi_square_passes(counts, np.full(bins, 1 / bins))


def many(draw, count=COUNT):
    rng = np.random.default_rng(7)
    return np.array([draw(rng) for _ in range(count)])


def test_the_test_itself_refuses_what_is_not_uniform():
    assert uniform_passes(many(lambda rng: rng.random()), 0, 1)
    assert not uniform_passes(many(lambda rng: rng.random() ** 1.15), 0, 1)


def test_numbers_are_uniform_log_uniform_or_constant():
    assert uniform_passes(many(lambda rng: ranges.number(rng, (2, 5))), 2, 5)
    values = many(lambda rng: ranges.number(rng, hd.log_uniform(0.1, 1000)))
    assert uniform_passes(np.log10(values), -1, 3)
    assert (many(lambda rng: ranges.number(rng, 3), 10) == 3).all()
    counts = np.bincount(many(lambda rng: ranges.whole(rng, (2, 6))).astype(int))
    assert len(counts) == 7 and chi_square_passes(counts[2:], np.full(5, 0.2))
    counts = np.bincount(many(hd.choice(0, 1, 2)).astype(int))
    assert chi_square_passes(counts, np.full(3, 1 / 3))


def test_directions_are_uniform_by_area():
    ways = many(lambda rng: ranges.direction(rng, (0.2, 1.1), (1.0, 2.5)))
    assert np.allclose(np.linalg.norm(ways, axis=1), 1)
    assert uniform_passes(ways[:, 2], np.sin(0.2), np.sin(1.1))
    assert uniform_passes(np.arctan2(ways[:, 1], ways[:, 0]), 1.0, 2.5)


def test_points_in_a_ball_are_uniform_by_volume():
    points = many(lambda rng: ranges.in_ball(rng, 2.0))
    assert uniform_passes((np.linalg.norm(points, axis=1) / 2) ** 3, 0, 1)


def test_rotations_are_uniform():
    """The images of two axes are uniform on the sphere, and the angle has the density
    (1 - cos) / pi of the Haar measure."""
    turns = many(ranges.rotation)
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1)
    assert uniform_passes(turns[:, 2, 0], -1, 1) and uniform_passes(turns[:, 0, 2], -1, 1)
    angle = np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert uniform_passes((angle - np.sin(angle)) / np.pi, 0, 1)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, -0.8)])
def test_the_shortest_turn_takes_z_there(axis):
    turn = ranges.turn_onto(np.array(axis, "f8"))
    assert np.allclose(turn[:, 2], axis) and np.isclose(np.linalg.det(turn), 1)


def test_colours_are_linear_and_their_hues_uniform():
    colors = many(hd.hsv_color(saturation=1.0, value=1.0))
    assert np.isclose(colors.max(axis=1), 1).all() and np.isclose(colors.min(axis=1), 0).all()
    assert chi_square_passes(np.bincount(colors.argmax(axis=1)), np.full(3, 1 / 3))


@pytest.mark.parametrize("bad", [(1, 0), (1, 2, 3), float("nan"), -1, (0.5, 2)])
def test_ranges_that_make_no_sense_are_refused(bad):
    with pytest.raises(hg.InvalidArgument, match="field") as caught:
        ranges.checked_range(bad, "field", 0, 1)
    assert caught.value.field == "field"


def stand_in(corners, triangles):
    """A Draw of one body whose pose is the identity."""
    body = types.SimpleNamespace(root=None, triangles=np.array(triangles))
    body.world = lambda pose: np.array(corners, "f8")
    bodies = types.SimpleNamespace(some=lambda entities, field: [body])
    return types.SimpleNamespace(bodies=bodies, pose=lambda root: np.eye(4))


# An L of three unit squares, the last of them inclined, and a wall.
L_CORNERS = [
    *[(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)],
    *[(0, 1, 0), (1, 1, 0), (1, 2, 0.5), (0, 2, 0.5)],
    *[(0, 0, 0), (0, 0, 1), (0, 1, 1)],
]
L_TRIANGLES = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7), (8, 9, 10)]


def test_points_are_uniform_over_what_faces_up():
    top = surface.Surface(stand_in(L_CORNERS, L_TRIANGLES), None, np.pi / 4)
    assert np.isclose(top.areas.sum(), 2 + np.hypot(1, 0.5))
    whole = top.within(top.middle, np.inf)
    points = many(lambda rng: whole.point(rng)[0])
    inclined = points[:, 1] > 1
    share = np.hypot(1, 0.5) / top.areas.sum()
    assert chi_square_passes([inclined.sum(), (~inclined).sum()], [share, 1 - share])
    assert uniform_passes(points[~inclined, 0], 0, 2) and uniform_passes(points[inclined, 1], 1, 2)
    assert top.carries(points, 1e-9) and not top.carries(points + (0, 0, 0.1), 1e-3)
    assert not top.carries(np.array([(1.5, 1.5, 0.0)]), 1e-3)


def test_points_are_uniform_in_a_disc_of_a_large_surface():
    """Both ways of drawing occur: the disc lies in large triangles, and over small ones."""
    size = 100.0
    corners = [(-size, -size, 0), (size, -size, 0), (size, size, 0), (-size, size, 0)]
    fine = [(x, y, 0) for y in np.linspace(0, 1, 3) for x in np.linspace(0, 1, 3)]
    quads = [(a, a + 1, a + 4, a + 3) for a in (0, 1, 3, 4)]
    split = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    for plane in (stand_in(corners, [(0, 1, 2), (0, 2, 3)]), stand_in(fine, split)):
        around = np.array([0.5, 0.5, 0.1])
        patch = surface.Surface(plane, None, 0.1).within(around, 0.4)
        disc = np.sqrt(0.4**2 - 0.1**2)
        points = many(lambda rng, p=patch: p.point(rng)[0]) - around
        assert uniform_passes((np.linalg.norm(points[:, :2], axis=1) / disc) ** 2, 0, 1)
        assert uniform_passes(np.arctan2(points[:, 1], points[:, 0]), -np.pi, np.pi)


def test_a_surface_without_room_is_refused():
    top = surface.Surface(stand_in(L_CORNERS, L_TRIANGLES), None, np.pi / 4)
    with pytest.raises(hg.FailedPrecondition, match="radius"):
        top.within(np.array([5.0, 5, 5]), 1.0)
    with pytest.raises(hg.FailedPrecondition, match="faces up"):
        surface.Surface(stand_in(L_CORNERS, L_TRIANGLES[-1:]), None, np.pi / 4)
