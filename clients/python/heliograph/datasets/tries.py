"""Error after the last attempt of a draw or randomizer. Used by both."""

from __future__ import annotations

from ..errors import ResourceExhausted


def gave_up(message: str, field: str, tries: int) -> ResourceExhausted:
    """The message, with what was tried and one more as available and needed."""
    return ResourceExhausted(message, field=field, needed=tries + 1, allowed=tries)
