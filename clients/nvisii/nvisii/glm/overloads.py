"""Arguments by the names that GLM gives them, of functions that take them by position."""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import suppress
from inspect import Parameter, Signature
from typing import Any


def overloaded(*overloads: tuple[str, ...]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator. overloads: names in their order. Keyword arguments are passed on in the order of
    the first overload that they fit; TypeError where they fit none."""
    signatures = [
        Signature([Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names])
        for names in overloads
    ]

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        def in_order(values: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, ...]:
            for signature in signatures:
                with suppress(TypeError):
                    return signature.bind(*values, **named).args
            raise TypeError(f"{call.__name__} takes {' or '.join(map(str, signatures))}")

        @functools.wraps(function)
        def call(*values: Any, **named: Any) -> Any:
            return function(*(in_order(values, named) if named else values))

        return call

    return decorate
