"""vec2 .. vec4, ivec2 .. ivec4 and u16vec2 .. u16vec4: small vectors of fixed length."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

Numbers = Any  # a vector, list, tuple or array of the right length


def floats(value: Numbers, count: int, name: str, finite: bool = True) -> tuple[float, ...]:
    """`count` floats of any sequence; RuntimeError names the argument."""
    try:
        out = tuple(map(float, () if isinstance(value, (str, bytes)) else value))
    except (TypeError, ValueError):
        raise RuntimeError(f"{name}: needs {count} numbers, not {value!r}") from None
    if len(out) != count:
        raise RuntimeError(f"{name}: needs {count} numbers, has {len(out)}")
    if finite and not math.isfinite(sum(out)) and not all(map(math.isfinite, out)):
        raise RuntimeError(f"{name}: {out} are not all finite")
    return out


_REFLECTED = {
    np.add: "__radd__",
    np.subtract: "__rsub__",
    np.multiply: "__rmul__",
    np.true_divide: "__rtruediv__",
}


class Numeric:
    """Base of types that numpy takes as arrays. `array + vec3` is a vec3; all else gives arrays."""

    __slots__ = ()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **named: Any) -> Any:
        own = getattr(self, _REFLECTED.get(ufunc, ""), None)
        if own is not None and method == "__call__" and inputs[-1] is self and not named:
            out = NotImplemented if np.ndim(inputs[0]) > 1 else own(inputs[0])
            if out is not NotImplemented:
                return out
        arrays = [np.asarray(v) if isinstance(v, Numeric) else v for v in inputs]
        return getattr(ufunc, method)(*arrays, **named)


class Vector(Numeric):
    """Numbers with names and arithmetic; made of numbers and shorter vectors, or of one number."""

    size: ClassVar[int]
    scalar: ClassVar[Any] = float
    __slots__ = ("_values",)
    _values: list[Any]
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, *values: Any) -> None:
        if len(values) == self.size:
            try:
                self._values = list(map(self.scalar, values))
                return
            except (TypeError, ValueError, OverflowError):
                pass  # some are vectors, or no numbers
        flat: list[Any] = []
        for value in values:
            flat.extend([value] if np.ndim(value) == 0 else value)
        if len(flat) == 1 and np.ndim(values[0]) == 0:
            flat *= self.size
        if not values:
            flat = [0] * self.size
        if len(flat) < self.size or (len(flat) > self.size and len(values) > 1):
            raise RuntimeError(f"{type(self).__name__} has {self.size} numbers, not {len(flat)}")
        try:
            self._values = [self.scalar(v) for v in flat[: self.size]]
        except (TypeError, ValueError, OverflowError):
            raise RuntimeError(f"{type(self).__name__}: not numbers: {flat!r}") from None

    def __len__(self) -> int:
        return self.size

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values)

    def __getitem__(self, index: Any) -> Any:
        return self._values[index]

    def __setitem__(self, index: int, value: Any) -> None:
        self._values[index] = self.scalar(value)

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(self._values, dtype=dtype)

    def __eq__(self, other: object) -> bool:
        try:
            return list(other) == self._values  # type: ignore[call-overload, no-any-return]
        except TypeError:
            return NotImplemented

    def __repr__(self) -> str:
        text = ", ".join(f"{v:f}" if isinstance(v, float) else str(v) for v in self._values)
        return f"{type(self).__name__}({text})"

    def _with(self, other: Any, function: Callable[[Any, Any], Any], swap: bool = False) -> Any:
        """Component by component, with a number or a sequence."""
        dimensions = np.ndim(other)
        if dimensions == 0:
            if not isinstance(other, (int, float, np.number)):
                return NotImplemented
            others: Sequence[Any] = [other] * self.size
        else:
            others = list(other)
            if len(others) != self.size or dimensions > 1:
                return NotImplemented
        pairs = zip(others, self._values) if swap else zip(self._values, others)
        return type(self)(*(function(a, b) for a, b in pairs))

    def __add__(self, other: Any) -> Any:
        return self._with(other, operator.add)

    def __radd__(self, other: Any) -> Any:
        return self._with(other, operator.add)

    def __sub__(self, other: Any) -> Any:
        return self._with(other, operator.sub)

    def __rsub__(self, other: Any) -> Any:
        return self._with(other, operator.sub, swap=True)

    def __mul__(self, other: Any) -> Any:
        return self._with(other, operator.mul)

    def __rmul__(self, other: Any) -> Any:
        return self._with(other, operator.mul)

    def __truediv__(self, other: Any) -> Any:
        return self._with(other, operator.truediv)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with(other, operator.truediv, swap=True)

    def __mod__(self, other: Any) -> Any:
        return self._with(other, operator.mod)

    def __neg__(self) -> Any:
        return type(self)(*(-v for v in self._values))

    def __pos__(self) -> Any:
        return type(self)(*self._values)

    def __abs__(self) -> Any:
        return type(self)(*map(abs, self._values))


def _component(index: int) -> Any:
    def read(self: Vector) -> Any:
        return self._values[index]

    def write(self: Vector, value: Any) -> None:
        self[index] = value

    return property(read, write)


def _vector(name: str, size: int, scalar: Callable[[Any], Any]) -> Any:
    members: dict[str, Any] = {
        "__slots__": (),
        "__doc__": f"{size} numbers.",
        "__module__": __name__,
        "size": size,
        "scalar": staticmethod(scalar),
    }
    for index in range(size):
        for letter in ("xyzw"[index], "rgba"[index]):
            members[letter] = _component(index)
    return type(name, (Vector,), members)


def _u16(value: Any) -> int:
    return int(value) & 0xFFFF


vec2, vec3, vec4 = (_vector(f"vec{n}", n, float) for n in (2, 3, 4))
ivec2, ivec3, ivec4 = (_vector(f"ivec{n}", n, int) for n in (2, 3, 4))
u16vec2, u16vec3, u16vec4 = (_vector(f"u16vec{n}", n, _u16) for n in (2, 3, 4))
BY_SIZE = {2: vec2, 3: vec3, 4: vec4}
