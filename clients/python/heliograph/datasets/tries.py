"""Error after the last attempt of a draw or randomizer. Used by both."""

from __future__ import annotations

from ..errors import ResourceExhausted


def gave_up(message: str, field: str, tries: int) -> ResourceExhausted:
    """Error with the message; `allowed` is the number of tries, `needed` one more."""
    return ResourceExhausted(message, field=field, needed=tries + 1, allowed=tries)
