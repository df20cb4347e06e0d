"""Run lengths of masks, against pycocotools."""

import numpy as np
import pytest
from heliograph.datasets.writers import rle
from pycocotools import mask as oracle


def test_counts_are_column_by_column_and_begin_with_zeros():
    mask = np.zeros((4, 5), dtype=bool)
    mask[1:3, 2:4] = True
    assert rle.counts_of(mask) == [9, 2, 2, 2, 5]
    mask[0, 0] = True
    assert rle.counts_of(mask) == [0, 1, 8, 2, 2, 2, 5]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("size", [(1, 1), (37, 53), (480, 640)])
def test_compressed_counts_are_those_of_pycocotools(share, size):
    mask = np.random.default_rng(3).random(size) < share
    counts = rle.counts_of(mask)
    assert rle.compressed(counts) == oracle.encode(np.asfortranarray(mask))["counts"].decode()
    np.testing.assert_array_equal(rle.mask_of(counts, *size), mask)


def test_all_ids_of_a_plane_in_one_pass():
    ids = np.random.default_rng(1).integers(0, 5, (23, 31)).astype(np.uint32)
    runs = rle.runs_of_ids(ids)
    assert sorted(runs) == [1, 2, 3, 4]
    for label, counts in runs.items():
        np.testing.assert_array_equal(rle.mask_of(counts, 23, 31), ids == label)
