"""RuntimeErrors: of single numbers, by the argument's name; of the daemon."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import heliograph as hg


@contextmanager
def as_runtime_error() -> Iterator[None]:
    """What the daemon refuses is a RuntimeError, as all errors here are."""
    try:
        yield
    except hg.HeliographError as error:
        raise RuntimeError(str(error)) from error


def number(name: str, value: Any) -> float:
    """A finite one."""
    try:
        out = float(value)
    except (TypeError, ValueError):
        raise RuntimeError(f"{name}: needs a number, not {value!r}") from None
    if not math.isfinite(out):
        raise RuntimeError(f"{name}: {value} is not finite")
    return out


def above_zero(name: str, value: float) -> float:
    if not number(name, value) > 0:
        raise RuntimeError(f"{name}: {value} is not above 0")
    return float(value)


def not_below_zero(name: str, value: float) -> float:
    if not number(name, value) >= 0:
        raise RuntimeError(f"{name}: {value} is below 0")
    return float(value)
