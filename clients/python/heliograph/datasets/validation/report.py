"""Results of a validation: Fault, Report, and Faults, which gathers them for one format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple


class Fault(NamedTuple):
    """Fault of a data set. check: "coco.bbox"; file: relative to the data set; message: the
    expected and the found value, and the remedy."""

    check: str
    file: str
    message: str


class LeftOut(NamedTuple):
    """A check that could not be made of some pieces, and why."""

    check: str
    reason: str
    pieces: int


@dataclass
class Report:
    """Result of validate().

    formats: recognised, or requested. faults: at most `limit` per check, in a fixed order. counts:
    check to the number of all its faults. checked: format to the number of pieces (images, scenes,
    shards or files) looked at. left_out: checks that could not be made, and why.
    """

    directory: str
    formats: list[str] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    checked: dict[str, int] = field(default_factory=dict)
    left_out: list[LeftOut] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True without a fault."""
        return not self.counts

    def __str__(self) -> str:
        looked = ", ".join(f"{name} ({self.checked[name]} pieces)" for name in self.formats)
        lines = []
        for check, count in sorted(self.counts.items()):
            shown = [fault for fault in self.faults if fault.check == check]
            cut = f", the first {len(shown)}" if len(shown) < count else ""
            lines.append(f"{check}: {count} fault{'s' * (count != 1)}{cut}")
            lines += [f"  {fault.file}: {fault.message}" for fault in shown]
        lines += [f"{o.check}: left out {o.pieces} times: {o.reason}" for o in self.left_out]
        total = sum(self.counts.values())
        lines.append(f"{self.directory}: {looked}: {f'{total} faults' if total else 'no faults'}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Report as an object of JSON."""
        return {
            "directory": self.directory,
            "ok": self.ok,
            "formats": self.formats,
            "checked": self.checked,
            "counts": self.counts,
            "faults": [fault._asdict() for fault in self.faults],
            "left_out": [each._asdict() for each in self.left_out],
        }


class Malformed(Exception):
    """A file that cannot be read on: it becomes a fault of the check `format`."""

    def __init__(self, file: Path, message: str) -> None:
        super().__init__(message)
        self.file, self.message = file, message


class Faults:
    """Gathers the faults of one format: at most `limit` a check are kept, all are counted."""

    def __init__(self, name: str, checks: Mapping[str, str], root: Path, limit: int) -> None:
        self.name, self.checks, self.root, self.limit = name, checks, root, limit
        self.kept: list[Fault] = []
        self.counts: Counter[str] = Counter()
        self.left: Counter[tuple[str, str]] = Counter()

    @property
    def left_out(self) -> list[LeftOut]:
        """Checks passed to leave(), with their numbers."""
        return [LeftOut(*each, count) for each, count in sorted(self.left.items())]

    def leave(self, check: str, reason: str) -> None:
        """Notes that a check could not be made of a piece."""
        assert check in self.checks, check
        self.left[f"{self.name}.{check}", reason] += 1

    def add(self, check: str, file: Path | str, message: str) -> None:
        """check: a key of the format's table of checks."""
        assert check in self.checks, check
        if isinstance(file, Path) and self.root in file.parents:
            file = file.relative_to(self.root).as_posix()
        self._keep(Fault(f"{self.name}.{check}", str(file), message))
        self.counts[f"{self.name}.{check}"] += 1

    def _keep(self, fault: Fault) -> None:
        if sum(kept.check == fault.check for kept in self.kept) < self.limit:
            self.kept.append(fault)

    def merge(self, other: Faults) -> None:
        """Appends the faults and counts of another one."""
        for fault in other.kept:
            self._keep(fault)
        self.counts.update(other.counts)
        self.left.update(other.left)
