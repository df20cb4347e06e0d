"""GLM's constants: functions without arguments, as pi()."""

from __future__ import annotations

import math
from collections.abc import Callable

_VALUES = {
    "e": math.e,
    "epsilon": 2.0**-23,  # of a float of 32 bits
    "euler": 0.57721566490153286,
    "four_over_pi": 4 / math.pi,
    "golden_ratio": (1 + math.sqrt(5)) / 2,
    "half_pi": math.pi / 2,
    "ln_ln_two": math.log(math.log(2)),
    "ln_ten": math.log(10),
    "ln_two": math.log(2),
    "one": 1.0,
    "one_over_pi": 1 / math.pi,
    "one_over_root_two": math.sqrt(0.5),
    "one_over_two_pi": 0.5 / math.pi,
    "pi": math.pi,
    "quarter_pi": math.pi / 4,
    "root_five": math.sqrt(5),
    "root_half_pi": math.sqrt(math.pi / 2),
    "root_ln_four": math.sqrt(math.log(4)),
    "root_pi": math.sqrt(math.pi),
    "root_three": math.sqrt(3),
    "root_two": math.sqrt(2),
    "root_two_pi": math.sqrt(2 * math.pi),
    "third": 1 / 3,
    "three_over_two_pi": 1.5 * math.pi,
    "two_over_pi": 2 / math.pi,
    "two_over_root_pi": 2 / math.sqrt(math.pi),
    "two_pi": 2 * math.pi,
    "two_thirds": 2 / 3,
    "zero": 0.0,
}


def _constant(name: str, value: float) -> Callable[[], float]:
    def read() -> float:
        return value

    read.__name__ = read.__qualname__ = name
    read.__doc__ = f"{value:.10g}"
    return read


CONSTANTS = {name: _constant(name, value) for name, value in _VALUES.items()}
