"""Shares of a job: indices of images, dealt in blocks to its workers. Used by torch.py and
cluster.py."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from ..errors import InvalidArgument
from ..values.checks import whole_of


def dealt(
    count: int | None, part: int = 0, parts: int = 1, *, block: int = 1, start: int = 0
) -> Iterator[int]:
    """Yields the indices of start .. start + count - 1 that part number `part` of `parts` makes.

    Blocks of `block` consecutive indices go round: block b to part b % parts. Over all parts each
    index comes once. count None: without end.
    """
    if not 0 <= part < parts:
        raise InvalidArgument(f"part: {part} is not one of {parts}, counted from 0", field="part")
    whole_of(block, "block", 1)
    last = None if count is None else start + whole_of(count, "count", 0)
    for number in itertools.count(part, parts):
        first = start + number * block
        if last is not None and first >= last:
            return
        yield from range(first, first + block if last is None else min(first + block, last))
