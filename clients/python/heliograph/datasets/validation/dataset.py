"""What generate() keeps about a data set in DIR/.heliograph, read as files."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from .files import OWN, batches, read_object
from .formats import Format, Task
from .report import Faults, Malformed

CHECKS = {
    "format": "dataset.json and every record are JSON objects",
    "counts": "a record and a manifest of each image asked for, and of no other",
    "partial": "no file was left half written",
}


def wanted_count(root: Path) -> int | None:
    """How many images the data set was to have, None where dataset.json does not say."""
    path = root / OWN / "dataset.json"
    if not path.is_file():
        return None
    count = read_object(path).get("count")
    if not isinstance(count, int):
        raise Malformed(path, f"count is {count!r}: needs a whole number")
    return count


def found(root: Path) -> bool:
    return (root / OWN / "dataset.json").is_file()


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = wanted_count(root)
    if count is None:
        raise Malformed(root / OWN / "dataset.json", "is not there: generate() writes it")
    names = [f"{index:06d}.json" for index in range(count)]
    for folder in ("records", "manifests"):
        own = root / OWN / folder
        there = {path.name for path in own.iterdir()} if own.is_dir() else set()
        missing = [name for name in names if name not in there]
        extra = sorted(there.difference(names))
        if missing:
            faults.add(
                "counts",
                own,
                f"{len(missing)} of {count} are missing, the first is {missing[0]}: call "
                "generate() again, it makes what is missing",
            )
        if extra:
            faults.add("counts", own, f"{extra[0]} is beyond the {count} images: remove it")
    partial_files = root / OWN / "partial"
    for left in sorted(partial_files.iterdir()) if partial_files.is_dir() else ():
        faults.add("partial", left, "was left by a run that was killed: remove it")
    for batch in batches(names, 256):
        yield partial(check_records, root / OWN / "records", batch)


def check_records(folder: Path, names: list[str], faults: Faults) -> None:
    """Are they JSON objects?"""
    for name in names:
        if (folder / name).is_file():
            read_object(folder / name)


FORMAT = Format("dataset", "what generate() keeps", f"{OWN}/dataset.json", CHECKS, found, tasks)
