"""Polygons of masks, against pycocotools."""

import numpy as np
import pytest
from heliograph.datasets.writers.outlines import area_of, joined, outlines
from pycocotools import mask as oracle


def drawn(polygon, height, width):
    rle = oracle.frPyObjects([polygon.ravel().astype(float).tolist()], height, width)
    return oracle.decode(rle)[..., 0].astype(bool)


def test_a_rectangle_has_four_corners_on_the_edges_of_pixels():
    mask = np.zeros((6, 7), dtype=bool)
    mask[1:3, 2:4] = True
    (found,) = outlines(mask)
    assert sorted(map(tuple, found.tolist())) == [(2, 1), (2, 3), (4, 1), (4, 3)]
    assert area_of(found) == 4
    np.testing.assert_array_equal(drawn(found, 6, 7), mask)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_areas_of_any_mask_sum_to_its_pixels(seed, share):
    mask = np.random.default_rng(seed).random((13, 17)) < share
    found = outlines(mask)
    assert sum(area_of(part) for part in found) == mask.sum()
    assert area_of(joined(found)) == mask.sum()
    for part in found:
        turns = np.diff(np.concatenate([part, part[:2]]), axis=0)
        assert ((turns == 0).sum(axis=1) == 1).all()  # along the axes
        assert (np.sum(turns[1:] * turns[:-1], axis=1) == 0).all()  # and around a corner each time


def test_a_blob_is_drawn_as_it_was():
    y, x = np.mgrid[:60, :80]
    mask = (x - 40) ** 2 / 900 + (y - 30) ** 2 / 400 < 1
    mask &= (x - 50) ** 2 + (y - 20) ** 2 > 90
    (found,) = outlines(mask)
    np.testing.assert_array_equal(drawn(found, 60, 80), mask)


def test_a_hole_stays_one_when_it_is_joined():
    y, x = np.mgrid[:40, :40]
    radius = np.hypot(x - 20, y - 20)
    mask = (radius < 15) & (radius > 6)
    parts = outlines(mask)
    assert sorted(np.sign([area_of(part) for part in parts])) == [-1, 1]
    differs = drawn(joined(parts), 40, 40) ^ mask
    assert differs.sum() <= 15  # at most the way to the hole
