"""validate(): recognises the formats of a directory and runs their checks."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ...errors import HeliographError, InvalidArgument, NotFound
from ...render.progress import is_watched
from ...values.checks import whole_of
from .formats import Format, Task
from .report import Faults, Malformed, Report
from .table import FORMATS

_MALFORMED = (  # errors of reading a file that holds something unexpected
    *(LookupError, TypeError, ValueError, ArithmeticError, AttributeError, EOFError, RuntimeError),
    *(struct.error, zlib.error, zipfile.BadZipFile, SyntaxError, tokenize.TokenError, MemoryError),
)
_UNEXPECTED = "holds data that the format has not ({!r}): write it anew"


def validate(
    directory: str | os.PathLike[str],
    format: str | None = None,
    *,
    limit: int = 20,
    processes: int = 0,
    progress: bool | Callable[[int], Any] | None = None,
) -> Report:
    """Checks a data set against its format's rules and the arithmetic between its labels.

    directory: of the data set; or a file, a saved frame. format: one of FORMATS ("coco", ...);
    None: all whose files are there. limit: how many faults of a check the report lists; it counts
    all. processes: that many workers beside this process (call it beneath `if __name__ ==
    "__main__"`); 0: threads. progress: None shows a bar on a terminal or in a notebook; a callable
    gets the number of pieces done. Needs memory for the largest piece (an image, a scene of BOP, a
    shard's sample), not for the data set.

    NotFound: no such directory. InvalidArgument: `format`, or no format is recognised.
    """
    limit, processes = whole_of(limit, "limit", 1), whole_of(processes, "processes")
    root = Path(directory)
    if root.is_file() and format in (None, "frame"):
        format = "frame"
    elif not root.is_dir():
        raise NotFound(f"{root} is no directory: name the one that the data set was written to")
    chosen = recognised(root) if format is None else [_by_name(format)]
    report = Report(str(root), [one.name for one in chosen])
    with _Bar(progress) as bar:
        for one in chosen:
            faults = Faults(one.name, one.checks, root, limit)
            report.checked[one.name] = 0
            for found in _results(one, faults, processes):
                faults.merge(found)
                report.checked[one.name] += 1
                bar.step(one)
            report.faults += faults.kept
            report.counts.update(sorted(faults.counts.items()))
            report.left_out += faults.left_out
    return report


def recognised(root: Path) -> list[Format]:
    """The formats whose files are in a directory; InvalidArgument when there are none."""
    found = [one for one in FORMATS.values() if one.found(root)]
    if not found:
        wanted = "; ".join(f"{one.name}: {one.looks_for}" for one in FORMATS.values())
        raise InvalidArgument(
            f"{root} has files of no known format; looked for {wanted}", field="directory"
        )
    return found


def _by_name(name: str) -> Format:
    if name not in FORMATS:
        raise InvalidArgument(f"format: {name!r} is none of {', '.join(FORMATS)}", field="format")
    return FORMATS[name]


def _results(one: Format, faults: Faults, processes: int) -> Iterator[Faults]:
    """The faults of every task, in the tasks' order, a bounded number of them under way."""
    workers = processes or os.cpu_count() or 1
    tasks = _guarded(one, faults)
    with _executor(processes, workers) as pool:
        under_way: deque[Future[Faults]] = deque()
        for task in tasks:
            under_way.append(pool.submit(run_task, one.name, task, faults.root, faults.limit))
            if len(under_way) >= 4 * workers:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()


def _executor(processes: int, workers: int) -> Executor:
    if processes:
        return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
    return ThreadPoolExecutor(workers)


def _guarded(one: Format, faults: Faults) -> Iterator[Task]:
    """The tasks; a file that cannot be read ends them and is a fault."""
    try:
        yield from one.tasks(faults.root, faults)
    except Malformed as error:
        faults.add("format", error.file, error.message)
    except HeliographError:  # a package that is missing
        raise
    except _MALFORMED as error:
        faults.add("format", faults.root, _UNEXPECTED.format(error))


def run_task(name: str, task: Task, root: Path, limit: int) -> Faults:
    """Faults of one task. A file that cannot be read at all is a fault of the check `format`."""
    faults = Faults(name, FORMATS[name].checks, root, limit)
    try:
        task(faults)
    except Malformed as error:
        faults.add("format", error.file, error.message)
    except HeliographError:
        raise
    except _MALFORMED as error:
        file = next((a for a in getattr(task, "args", ()) if isinstance(a, Path)), root)
        faults.add("format", file, _UNEXPECTED.format(error))
    return faults


class _Bar:
    """Progress over the pieces."""

    def __init__(self, mode: bool | Callable[[int], Any] | None) -> None:
        self._callback = mode if callable(mode) else None
        self._wanted = mode is True or (mode is None and is_watched())
        self._bar: Any = None
        self._done = 0

    def __enter__(self) -> _Bar:
        return self

    def step(self, one: Format) -> None:
        self._done += 1
        if self._callback is not None:
            self._callback(self._done)
        elif self._wanted:
            if self._bar is None:
                from tqdm.auto import tqdm

                self._bar = tqdm(desc="validate", unit="piece", leave=False)
            self._bar.set_postfix_str(one.title, refresh=False)
            self._bar.update()

    def __exit__(self, *_: Any) -> None:
        if self._bar is not None:
            self._bar.close()
