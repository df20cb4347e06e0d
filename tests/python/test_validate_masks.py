"""The validator's own run lengths, against pycocotools."""

import numpy as np
import pytest
from heliograph.datasets.validation.masks import box_of_spans, counts_of_text, mask_of, spans_of
from pycocotools import mask as oracle


@pytest.mark.parametrize("seed", range(20))
def test_compressed_run_lengths_are_those_of_pycocotools(seed):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 300, 2)
    mask = rng.random((height, width)) < rng.choice([0.0, 0.01, 0.5, 0.99, 1.0])
    if seed % 2:  # long runs, whose numbers have several groups and signs
        mask[: height // 2] = True
    runs = oracle.encode(np.asfortranarray(mask.astype(np.uint8)))
    counts = counts_of_text(runs["counts"].decode())
    assert (mask_of(counts, (height, width)) == mask).all()
    spans = spans_of(counts, (height, width))
    x0, y0, x1, y1 = box_of_spans(spans, int(height))
    assert [x0, y0, x1 - x0, y1 - y0] == [int(v) for v in oracle.toBbox(runs)]
    assert (spans[:, 1] - spans[:, 0]).sum() == oracle.area(runs)


def test_what_is_no_text_of_run_lengths_is_refused():
    for text in ("", "\x01", "o", "é"):
        with pytest.raises(ValueError):
            counts_of_text(text)
