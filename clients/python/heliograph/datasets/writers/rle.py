"""Run lengths of masks as COCO has them: column by column, beginning with a run of zeros.

Format: cocodataset/cocoapi, common/maskApi.c (rleEncode, rleToString). Used by the COCO writer.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray


def runs_of_ids(ids: NdArray) -> dict[int, list[int]]:
    """Counts of the mask of every id of a plane (H, W), 0 excepted, in one pass."""
    flat = ids.T.ravel()
    starts = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1])
    ends = np.append(starts[1:], flat.size)
    values = flat[starts]
    order = np.argsort(values, kind="stable")
    bounds = np.flatnonzero(np.diff(values[order])) + 1
    out = {}
    for rows in np.split(order, bounds):
        label = int(values[rows[0]])
        if label:
            out[label] = _counts(starts[rows], ends[rows], flat.size)
    return out


def counts_of(mask: Any) -> list[int]:
    """Counts of one mask (H, W), bool."""
    mask = np.asarray(mask, dtype=np.uint8)
    return runs_of_ids(mask).get(1, [mask.size])


def _counts(starts: NdArray, ends: NdArray, size: int) -> list[int]:
    edges = np.empty(2 * len(starts) + 2, dtype=np.int64)
    edges[0], edges[-1] = 0, size
    edges[1:-1:2], edges[2:-1:2] = starts, ends
    counts: list[int] = np.diff(edges).tolist()
    return counts[:-1] if counts[-1] == 0 else counts


def compressed(counts: Sequence[int]) -> str:
    """COCO's text of counts: from the third on the difference to the one two before, in groups of
    five bits, least significant first, the sixth bit set where more follow, plus 48."""
    out = bytearray()
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        while True:
            low = value & 0x1F
            value >>= 5
            more = value != (-1 if low & 0x10 else 0)
            out.append((low | 0x20 if more else low) + 48)
            if not more:
                break
    return out.decode("ascii")


def mask_of(counts: Iterable[int], height: int, width: int) -> NdArray:
    """(H, W) bool: the mask that counts are of."""
    lengths = np.fromiter(counts, dtype=np.int64)
    flat = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
    return flat.reshape(width, height).T
