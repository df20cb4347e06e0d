"""Start of connect(), before anything heavy is imported. Used by __init__.py and link.py."""

from __future__ import annotations

import math
import os
import time
from typing import Any

from ..errors import InvalidArgument


class Deadline:
    """A time that connecting may take, which began when this was made."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._until = time.monotonic() + seconds

    @property
    def is_over(self) -> bool:
        return time.monotonic() > self._until

    def left(self) -> float:
        """Seconds, a millisecond at least: no socket takes 0 for a time."""
        return max(0.001, self._until - time.monotonic())


def deadline_of(timeout: Any, default: float | None) -> Deadline | None:
    """Deadline of connect()'s timeout=, seconds; None: neither it nor a default is given."""
    seconds = default if timeout is None else timeout
    if seconds is None:
        return None
    is_number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
    if not is_number or not math.isfinite(seconds) or seconds <= 0:
        raise InvalidArgument(f"timeout: seconds, above 0, not {timeout!r}", field="timeout")
    return Deadline(float(seconds))


def occupy_standard_streams() -> None:
    """Opens the null device as 0, 1 and 2 where they are closed, so that no connection gets one of
    these numbers: a child's streams would replace it, and what prints would write into it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number, inheritable=False)
                os.close(opened)
