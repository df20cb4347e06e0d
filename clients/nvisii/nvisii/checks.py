"""RuntimeErrors: of numbers and arrays, by the argument's name; of the daemon."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

import numpy as np

import heliograph as hg

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Class = TypeVar("_Class", bound=type)
_STOPS = 64.0  # the largest exposure, either way


@contextmanager
def as_runtime_error() -> Iterator[None]:
    """Raises RuntimeError, as all errors of this module are, where the daemon refuses something."""
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


def stops(name: str, value: float) -> float:
    """An exposure, -64 to 64."""
    if abs(number(name, value)) > _STOPS:
        raise RuntimeError(f"{name}: {value} is outside [-{_STOPS:g}, {_STOPS:g}]")
    return float(value)


def whole(name: str, value: Any, least: float = -math.inf) -> int:
    """A number without a fraction."""
    found = number(name, value)
    if found % 1:
        raise RuntimeError(f"{name}: {value} is no whole number")
    if found < least:
        raise RuntimeError(f"{name}: {value} is below {least}")
    return int(value)


def array(name: str, values: Any, dtype: Any = None) -> Any:
    """Array of finite numbers; RuntimeError for anything else."""
    try:
        out = np.asarray(values, dtype=dtype)
        finite = np.isfinite(out).all()
    except (TypeError, ValueError):
        raise RuntimeError(f"{name}: needs numbers") from None
    if not finite:
        raise RuntimeError(f"{name}: every number must be finite")
    return out


_CHECKS: dict[str, Callable[[str, Any], Any]] = {"float": number, "int": whole}


def checked(function: _Function) -> _Function:
    """Decorator: number() of the arguments that are annotated as float, whole() of those as int.
    Annotations must be strings, as the __future__ import makes them."""
    signature = inspect.signature(function)
    checks = {name: _CHECKS.get(p.annotation) for name, p in signature.parameters.items()}

    @functools.wraps(function)
    def call(*values: Any, **named: Any) -> Any:
        given = signature.bind(*values, **named)
        for name, value in given.arguments.items():
            check = checks[name]
            if check is not None:
                given.arguments[name] = check(name, value)
        return function(*given.args, **given.kwargs)

    return cast(_Function, call)


def checked_factories(cls: _Class) -> _Class:
    """Class decorator: checked() of all create_*."""
    for name, found in list(vars(cls).items()):
        if name.startswith("create_"):
            setattr(cls, name, classmethod(checked(found.__func__)))
    return cls
