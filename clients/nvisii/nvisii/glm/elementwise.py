"""GLM's functions of each component: of numbers, vectors and sequences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .overloads import overloaded
from .vectors import BY_SIZE, Vector


def _fract(x: Any) -> Any:
    return x - np.floor(x)


def _round(x: Any) -> Any:
    """Halves away from 0."""
    return np.copysign(np.floor(np.abs(x) + 0.5), x)


def _mod(x: Any, y: Any) -> Any:
    return x - y * np.floor(x / y)


def _clamp(x: Any, minVal: Any, maxVal: Any) -> Any:
    return np.minimum(np.maximum(x, minVal), maxVal)


def _step(edge: Any, x: Any) -> Any:
    return np.where(x < edge, 0.0, 1.0)


def _smoothstep(edge0: Any, edge1: Any, x: Any) -> Any:
    t = np.clip((x - edge0) / (edge1 - edge0), 0, 1)
    return t * t * (3 - 2 * t)


def _fma(a: Any, b: Any, c: Any) -> Any:
    return a * b + c


def _repeat(x: Any) -> Any:
    return x - np.floor(x)


def _atan(y: Any, x: Any = None) -> Any:
    return np.arctan(y) if x is None else np.arctan2(y, x)


def _mirror_repeat(x: Any) -> Any:
    whole, part = np.floor(np.abs(x)), _fract(np.abs(x))
    return np.where(whole % 2 == 1, 1 - part, part)


def _one(function: Callable[..., Any], name: str = "x") -> tuple[Any, ...]:
    return function, (name,)


# Name: function of arrays, names of its arguments, names in another overload.
_TABLE: dict[str, tuple[Any, ...]] = {
    "abs": _one(np.abs),
    "acos": _one(np.arccos),
    "acosh": _one(np.arccosh),
    "asin": _one(np.arcsin),
    "asinh": _one(np.arcsinh),
    "atan": (_atan, ("y", "x"), ("y_over_x",)),
    "atanh": _one(np.arctanh),
    "ceil": _one(np.ceil),
    "clamp": (_clamp, ("x", "minVal", "maxVal")),
    "cos": _one(np.cos, "angle"),
    "cosh": _one(np.cosh, "angle"),
    "degrees": (np.degrees, ("radians",)),
    "exp": _one(np.exp, "v"),
    "exp2": _one(np.exp2, "v"),
    "floor": _one(np.floor),
    "fma": (_fma, ("a", "b", "c")),
    "fract": _one(_fract),
    "inversesqrt": _one(lambda v: 1 / np.sqrt(v), "v"),
    "isinf": _one(np.isinf),
    "isnan": _one(np.isnan),
    "log": _one(np.log, "v"),
    "log2": _one(np.log2, "v"),
    "max": (np.maximum, ("x", "y")),
    "min": (np.minimum, ("x", "y")),
    "mirrorRepeat": _one(_mirror_repeat, "Texcoord"),
    "mod": (_mod, ("x", "y")),
    "pow": (np.power, ("base", "exponent")),
    "radians": (np.radians, ("degrees",)),
    "repeat": _one(_repeat, "Texcoord"),
    "round": _one(_round),
    "roundEven": _one(np.rint),
    "sign": _one(np.sign),
    "sin": _one(np.sin, "angle"),
    "sinh": _one(np.sinh, "angle"),
    "smoothstep": (_smoothstep, ("edge0", "edge1", "x")),
    "sqrt": _one(np.sqrt, "v"),
    "step": (_step, ("edge", "x")),
    "tan": _one(np.tan, "angle"),
    "tanh": _one(np.tanh, "angle"),
    "trunc": _one(np.trunc),
}


def numbers(value: Any) -> Any:
    """float64 of a number, a vector or a sequence; RuntimeError for anything else."""
    try:
        return np.asarray(list(value) if np.ndim(value) else value, dtype=float)
    except (TypeError, ValueError):
        raise RuntimeError(f"needs numbers, not {value!r}") from None


def like(result: Any, given: tuple[Any, ...]) -> Any:
    """A number, or a vector of the kind that was given."""
    if np.ndim(result) == 0:
        return result.item()
    kinds = [type(v) for v in given if isinstance(v, Vector)]
    kind: Any = kinds[0] if kinds else BY_SIZE.get(len(result))
    if kind is None:
        raise RuntimeError(f"needs numbers or vectors of 2 to 4, not of {len(result)}")
    if result.dtype == bool:
        return [bool(v) for v in result]
    return kind(*result.tolist())


def _elementwise(name: str) -> Callable[..., Any]:
    function, *overloads = _TABLE[name]
    usage = " or ".join(f"{name}({', '.join(names)})" for names in overloads)

    @overloaded(*overloads)
    def call(*values: Any) -> Any:
        arrays = [numbers(value) for value in values]
        try:
            with np.errstate(all="ignore"):
                return like(np.asarray(function(*arrays)), values)
        except ValueError:
            raise RuntimeError(f"{name}: vectors of different lengths") from None
        except TypeError:
            raise RuntimeError(f"usage: {usage}") from None

    call.__name__ = call.__qualname__ = name
    call.__doc__ = f"{usage} of each component."
    return call


ELEMENTWISE = {name: _elementwise(name) for name in _TABLE}
