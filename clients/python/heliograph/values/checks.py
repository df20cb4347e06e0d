"""Checks of users' values: numbers, colours, texts, keywords. An error names the field."""

from __future__ import annotations

import difflib
import math
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._wire._proto import types_pb2 as types
from .._wire.arrays import checked
from ..errors import InvalidArgument


def refuse_unknown(given: Mapping[str, Any], known: type, what: str) -> None:
    """InvalidArgument with the nearest names, or all, when a keyword is none of the TypedDict's."""
    for name in given:
        if name not in known.__annotations__:
            near = difflib.get_close_matches(name, known.__annotations__, 3, 0.7)
            hint = f"did you mean {' or '.join(near)}?"
            if not near:
                hint = f"there are {', '.join(known.__annotations__)}"
            raise InvalidArgument(f"{what} has no {name!r}; {hint}", field=name)


def refuse_given(given: Mapping[str, Any], defaults: Mapping[str, Any], why: str) -> None:
    """Raises InvalidArgument for arguments that are not the default, where they would change
    nothing."""
    for name, value in given.items():
        if value != defaults[name]:
            raise InvalidArgument(f"{name}: {why}", field=name)


def color_of(value: Any, field: str) -> types.Vec3:
    """A Vec3 of a number (grey) or (3,)."""
    if _is_float(value):
        return types.Vec3(x=value, y=value, z=value)
    if not (type(value) is tuple and len(value) == 3 and all(map(_is_float, value))):
        value = (value, value, value) if np.ndim(value) == 0 else value
        value = checked(value, field, "f8", (3,)).tolist()
    x, y, z = value
    return types.Vec3(x=x, y=y, z=z)


def number_of(value: Any, field: str) -> float:
    """A finite float."""
    if _is_float(value):  # numpy takes ten times as long
        return float(value)
    return float(checked(value, field, "f8", ()))


def _is_float(value: Any) -> bool:
    return type(value) is float and math.isfinite(value)


def text_of(value: Any, field: str) -> str:
    """A str, and nothing that only looks like one."""
    if isinstance(value, str):
        return value
    raise InvalidArgument(f"{field}: needs a str, not {value!r}", field=field)


def whole_of(value: Any, field: str, low: int = 0, high: int = 2**32 - 1) -> int:
    """A whole number in [low, high]."""
    try:
        whole = operator.index(value)
    except TypeError:
        number = number_of(value, field)
        if number % 1:
            raise InvalidArgument(f"{field}: {value} is no whole number", field=field) from None
        whole = int(number)
    if not low <= whole <= high:
        raise InvalidArgument(
            f"{field}: {whole} is outside [{low}, {high}]; give a whole number in it", field=field
        )
    return whole
