"""Splits: the one of each image follows from its index. Used by generate()."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import InvalidArgument
from ..values.checks import number_of

_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 / golden ratio


class Splits:
    """Shares of the draws, by name.

    Draw i goes by the fraction of phase(seed) + i / golden ratio (Weyl 1916): any run of draws has
    the shares within about one image, a draw stays where it is when the data set grows, and all
    cameras of a draw go together.
    """

    def __init__(self, shares: Mapping[str, Any] | None) -> None:
        given = {name: number_of(s, f"splits[{name!r}]") for name, s in (shares or {}).items()}
        if any(not name or not name.isidentifier() for name in given):
            raise InvalidArgument(f"splits: names are words, not {list(given)}", field="splits")
        if given and (min(given.values()) < 0 or abs(sum(given.values()) - 1) > 1e-6):
            raise InvalidArgument(
                f"splits: shares are >= 0 and sum to 1, not {sum(given.values()):g}", field="splits"
            )
        self.shares = given

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.shares)

    def of(self, seed: int, draw: int) -> str:
        """The split of a draw; "" without splits."""
        place = ((seed * 0xBF58476D1CE4E5B9 + (draw + 1) * _GOLDEN) & (2**64 - 1)) / 2**64
        upper = 0.0
        for name, share in self.shares.items():
            upper += share
            if place < upper:
                return name
        return next(reversed(self.shares), "")
