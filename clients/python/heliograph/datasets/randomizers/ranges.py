"""Distributions of the randomizers: ranges, directions, rotations. Used by all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Union

import numpy as np

from ..._wire.arrays import NdArray, checked
from ...errors import InvalidArgument
from ...values.checks import number_of

Range = Union[float, "tuple[float, float]", Callable[[np.random.Generator], float]]
"""A number; (low, high): uniform between them; or a callable (rng) -> number."""


class LogUniform:
    """Its logarithm is uniform: as many values between 1 and 10 as between 10 and 100."""

    def __init__(self, low: float, high: float) -> None:
        ends = _ends((low, high), (0, math.inf))
        if ends is None or ends[0] == 0:
            raise InvalidArgument(
                f"log_uniform: needs 0 < low <= high, not {low!r}, {high!r}", field="log_uniform"
            )
        self.low, self.high = ends

    def __call__(self, rng: np.random.Generator) -> float:
        return float(self.low * (self.high / self.low) ** rng.random())


class Choice:
    """Distribution over some values, all with the same probability."""

    def __init__(self, *values: Any) -> None:
        if not values:
            raise InvalidArgument("choice: needs at least one value", field="choice")
        self.values = values

    def __call__(self, rng: np.random.Generator) -> Any:
        return self.values[int(rng.integers(len(self.values)))]


def checked_range(given: Any, field: str, low: float = -math.inf, high: float = math.inf) -> Any:
    """`given` if it is a Range whose ends lie in [low, high]."""
    if callable(given):
        return given
    ends = _ends(given, (low, high))
    if ends is None:
        raise InvalidArgument(
            f"{field}: needs a number, (low, high) or a callable (rng) -> number, within "
            f"[{low:g}, {high:g}]; not {given!r}",
            field=field,
        )
    return ends if np.ndim(given) else ends[0]


def checked_pair(given: Any, field: str, low: float = -math.inf) -> tuple[float, float]:
    """(low, high) of a number or of such a pair, no less than `low`."""
    ends = _ends(given, (low, math.inf))
    if ends is None:
        raise InvalidArgument(
            f"{field}: needs a number or (low, high), of at least {low:g}; not {given!r}",
            field=field,
        )
    return ends


def checked_number(given: Any, field: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A number in [low, high]."""
    value = number_of(given, field)
    if not low <= value <= high:
        raise InvalidArgument(
            f"{field}: needs a number within [{low:g}, {high:g}], not {given!r}", field=field
        )
    return value


def checked_count(given: Any, field: str) -> Any:
    """`given` if it is a Range of whole numbers from 0."""
    count = checked_range(given, field, 0)
    if not callable(count) and (np.asarray(count) % 1).any():
        raise InvalidArgument(f"{field}: needs whole numbers, not {given!r}", field=field)
    return count


def _ends(given: Any, limits: tuple[float, float]) -> tuple[float, float] | None:
    """(low, high), the same for a number; None for anything else, or beyond the limits."""
    try:
        ends = np.asarray(given)
    except ValueError:  # of rows that differ in length
        return None
    if ends.dtype.kind not in "biuf" or ends.shape not in ((), (2,)):
        return None
    low, high = np.broadcast_to(ends, 2).tolist()
    within = math.isfinite(low) and math.isfinite(high) and limits[0] <= low <= high <= limits[1]
    return (float(low), float(high)) if within else None


def number(rng: np.random.Generator, given: Any) -> float:
    """Draws one number of a Range."""
    if callable(given):
        return float(given(rng))
    if np.ndim(given) == 0:
        return float(given)
    return float(rng.uniform(given[0], given[1]))


def whole(rng: np.random.Generator, given: Any) -> int:
    """Draws one whole number of a Range, both ends included."""
    if callable(given):
        return int(given(rng))
    if np.ndim(given) == 0:
        return int(given)
    return int(rng.integers(int(given[0]), int(given[1]) + 1))


def color(rng: np.random.Generator, given: Any) -> NdArray:
    """Draws a linear colour (3,): uniform between ((r, g, b), (r, g, b)); one (r, g, b) as it is;
    or the value of a callable (rng)."""
    if callable(given):
        return np.asarray(given(rng), dtype="f8")
    ends = np.asarray(given, dtype="f8")
    return np.asarray(rng.uniform(ends[0], ends[1]) if ends.ndim == 2 else ends)


def checked_color(given: Any, field: str) -> Any:
    """`given` if color() takes it."""
    if callable(given):
        return given
    shape = np.shape(given)
    if shape not in ((3,), (2, 3)):
        raise InvalidArgument(
            f"{field}: needs (r, g, b), ((r, g, b), (r, g, b)) or a callable, has shape {shape}",
            field=field,
        )
    color = checked(given, field, "f8", shape)
    if len(shape) == 2 and (color[0] > color[1]).any():
        raise InvalidArgument(f"{field}: the first color is the lower one", field=field)
    return color


class HsvColor:
    """Linear colours of uniform hue, saturation and value of sRGB, which look evenly mixed."""

    def __init__(self, saturation: Range = (0.2, 0.9), value: Range = (0.3, 0.95)) -> None:
        self.saturation = checked_range(saturation, "saturation", 0, 1)
        self.value = checked_range(value, "value", 0, 1)

    def __call__(self, rng: np.random.Generator) -> NdArray:
        import colorsys

        hue = rng.random()
        encoded = colorsys.hsv_to_rgb(hue, number(rng, self.saturation), number(rng, self.value))
        return linear(np.array(encoded))


def linear(encoded: NdArray) -> NdArray:
    """sRGB in [0, 1] to scene-linear (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def direction(
    rng: np.random.Generator,
    elevation: Range = (-math.pi / 2, math.pi / 2),
    azimuth: Range = (0.0, 2 * math.pi),
) -> NdArray:
    """(3,) unit vector. Pairs give a uniform density on that part of the sphere: the sine of the
    elevation is uniform, not the elevation."""
    if isinstance(elevation, Sequence):
        sine = float(rng.uniform(math.sin(elevation[0]), math.sin(elevation[1])))
    else:
        sine = math.sin(number(rng, elevation))
    cosine, around = math.sqrt(max(0.0, 1 - sine * sine)), number(rng, azimuth)
    return np.array([cosine * math.cos(around), cosine * math.sin(around), sine])


def in_ball(rng: np.random.Generator, radius: float) -> NdArray:
    """(3,) uniform in the volume of a ball about the origin."""
    return np.asarray(radius * rng.random() ** (1 / 3) * direction(rng))


def rotation(rng: np.random.Generator) -> NdArray:
    """(3, 3), uniform over all rotations.

    Source: Shoemake 1992, "Uniform Random Rotations", Graphics Gems III.
    """
    from ...values.pose import rotation_of_wxyz

    u, a, b = rng.random(), *(2 * math.pi * rng.random(2))
    p, q = math.sqrt(1 - u), math.sqrt(u)
    return rotation_of_wxyz(
        np.array([q * math.cos(b), p * math.sin(a), p * math.cos(a), q * math.sin(b)])
    )


def turn(axis: NdArray, angle: float) -> NdArray:
    """(3, 3): by radians about a unit axis."""
    from ...values.pose import rotation_of_wxyz

    half = 0.5 * angle
    return rotation_of_wxyz(np.array([math.cos(half), *(math.sin(half) * axis)]))


def turn_onto(direction: NdArray) -> NdArray:
    """(3, 3): the shortest rotation of +Z onto a unit vector."""
    axis = np.array([-direction[1], direction[0], 0.0])
    length = float(np.linalg.norm(axis))
    if length < 1e-12:
        return np.diag([1.0, 1.0, 1.0]) if direction[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return turn(axis / length, math.atan2(length, float(direction[2])))
