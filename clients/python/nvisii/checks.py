"""Checks of single numbers; RuntimeError names the argument."""

from __future__ import annotations


def above_zero(name: str, value: float) -> float:
    if not float(value) > 0:
        raise RuntimeError(f"{name}: {value} is not above 0")
    return float(value)


def not_below_zero(name: str, value: float) -> float:
    if not float(value) >= 0:
        raise RuntimeError(f"{name}: {value} is below 0")
    return float(value)
