"""Faults in a robot's file: warnings, or errors where it is read strictly. Used by urdf.py."""

from __future__ import annotations

from pathlib import Path

from ..errors import HeliographError, InvalidArgument, NotFound, Unimplemented

FAULTS = (InvalidArgument, NotFound, Unimplemented)  # of files that the rest can do without


class Notes:
    """Warnings about a robot's file. strict: refuses the file instead."""

    def __init__(self, path: Path, strict: bool) -> None:
        self.path = path
        self.strict = strict
        self.warnings: list[str] = []

    def refusal(self, message: str, where: str = "") -> InvalidArgument:
        return InvalidArgument(f"{self._at(where)}{message}", field="path")

    def missing(self, message: str, where: str, field: str = "path") -> NotFound:
        return NotFound(f"{self._at(where)}{message}", field=field)

    def warn(self, text: str) -> None:
        if self.strict:
            raise self.refusal(text)
        if text not in self.warnings:
            self.warnings.append(text)

    def leave_out(self, error: HeliographError) -> None:
        """Warns of an element with a fault, which is left out; strict: raises."""
        if self.strict:
            raise error
        self.warn(f"{str(error).removeprefix(self._at())}; it is left out")

    def _at(self, where: str = "") -> str:
        return f"{self.path}: {where}: " if where else f"{self.path}: "
