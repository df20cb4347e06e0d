"""Format: the description by each module of its format. Used by run.py and docs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from .report import Faults

Task = Callable[[Faults], None]  # picklable: a functools.partial of a module's function


@dataclass(frozen=True)
class Format:
    """Format of data sets. name: as in `--format` and before the dot of a check; title: as people
    write it.

    looks_for: the criterion of found(), in words. checks: name to the property that it makes sure
    of. tasks: makes the pieces to check, each on its own and in any order, and adds faults of the
    whole.
    """

    name: str
    title: str
    looks_for: str
    checks: Mapping[str, str]
    found: Callable[[Path], bool]
    tasks: Callable[[Path, Faults], Iterator[Task]]
