"""Work ahead of its consumer: results in the order of their items. Used by torch.py."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Prepared = TypeVar("Prepared")
Done = TypeVar("Done")


def in_order(
    items: Iterable[Item],
    prepare: Callable[[Item], Prepared],
    work: Callable[[Prepared], Done],
    ahead: int,
) -> Generator[Done, None, None]:
    """work(prepare(item)) of each item, in order; `ahead` of them are under way while the consumer
    has one.

    prepare: one call at a time, in order, in a thread of its own. work: up to max(1, ahead) calls
    at once, in other threads. An error is raised where its result would come, and ends the rest.
    Closing the iterator begins nothing more and waits for the calls under way.
    """
    waiting: deque[tuple[Future[Prepared], Future[Done]]] = deque()
    threads = ThreadPoolExecutor(max(1, ahead), "heliograph-work")
    with ThreadPoolExecutor(1, "heliograph-prepare") as preparer, threads as worker:

        def begin(item: Item) -> None:
            prepared = preparer.submit(prepare, item)
            waiting.append((prepared, worker.submit(lambda: work(prepared.result()))))

        source = iter(items)
        try:
            for item in itertools.islice(source, ahead):
                begin(item)
            while True:
                for item in itertools.islice(source, 1):
                    begin(item)
                if not waiting:
                    return
                yield waiting.popleft()[1].result()
        finally:
            for prepared, done in waiting:
                done.cancel()
                prepared.cancel()
