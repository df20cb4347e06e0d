"""Bundled textures: patterns computed from fixed numbers. Used by random_textures."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from ..._wire.arrays import NdArray

_SIZE = 608  # 1.1 MB: large enough to travel once, by its hash, so that a data set keeps it once
_EACH = 3  # of a kind
Generator = np.random.Generator


def bundled_textures() -> list[Callable[[], NdArray]]:
    """27 callables, each of which computes a picture: (608, 608, 3) uint8 sRGB, seamless;
    three each of checks, stripes, dots, bricks, planks, marble, clouds, terrazzo and weave; always
    the same."""
    count = len(_KINDS) * _EACH
    return [functools.partial(_picture, i // _EACH, i % _EACH) for i in range(count)]


def _picture(kind: int, variant: int) -> NdArray:
    rng = np.random.default_rng((kind, variant))
    shade = np.clip(_KINDS[kind](rng) + 0.06 * (noise(rng, 32, 4) - 0.5), 0, 1)[..., None]
    dark, light = palette(rng)
    grain = 1 + 0.12 * (noise(rng, 4, 5)[..., None] - 0.5)
    return np.asarray((255 * np.clip((dark + shade * (light - dark)) * grain, 0, 1)).astype("u1"))


def palette(rng: Generator) -> tuple[NdArray, NdArray]:
    """Two sRGB colours that differ in brightness, and mostly in hue a little."""
    import colorsys

    hue = rng.random()
    dark = colorsys.hsv_to_rgb(hue, rng.uniform(0.1, 0.8), rng.uniform(0.1, 0.45))
    other = (hue + rng.normal(0, 0.12)) % 1.0
    light = colorsys.hsv_to_rgb(other, rng.uniform(0.05, 0.6), rng.uniform(0.6, 0.95))
    return np.array(dark), np.array(light)


def _grid() -> tuple[NdArray, NdArray]:
    """x and y in [0, 1)."""
    line = (np.arange(_SIZE) + 0.5) / _SIZE
    x, y = np.meshgrid(line, line)
    return x, y


def noise(rng: Generator, cells: int, octaves: int) -> NdArray:
    """(608, 608) in [0, 1], seamless: octaves of smoothly interpolated random values."""
    total, weight = np.zeros((_SIZE, _SIZE)), 0.0
    for octave in range(octaves):
        n = cells << octave
        if n > _SIZE // 2:
            break
        weights = np.zeros((_SIZE, n))
        rows = np.arange(_SIZE)
        place = (rows + 0.5) / _SIZE * n
        low = place.astype(int)
        t = _smooth(place - low)
        weights[rows, low] = 1 - t
        weights[rows, (low + 1) % n] += t
        total += 0.5**octave * (weights @ rng.random((n, n)) @ weights.T)
        weight += 0.5**octave
    return np.asarray(total / weight)


def _checks(rng: Generator) -> NdArray:
    x, y = _grid()
    n = int(rng.integers(2, 7)) * 2
    return np.asarray(((x * n).astype(int) + (y * n).astype(int)) % 2 * 1.0)


def _stripes(rng: Generator) -> NdArray:
    x, y = _grid()
    a, b = rng.integers(1, 9), rng.integers(0, 6)
    return _edge(np.sin(2 * np.pi * (a * x + b * y)), 0.15)


def _dots(rng: Generator) -> NdArray:
    x, y = _grid()
    n, radius = int(rng.integers(4, 12)), rng.uniform(0.2, 0.42)
    return _edge(radius - np.hypot(x * n % 1 - 0.5, y * n % 1 - 0.5), 0.03)


def _bricks(rng: Generator) -> NdArray:
    x, y = _grid()
    rows = int(rng.integers(4, 9)) * 2
    row = (y * rows).astype(int)
    u = x * rows / 2 + 0.5 * (row % 2)
    edge = np.minimum(np.minimum(u % 1, 1 - u % 1) * 2, np.minimum(y * rows % 1, 1 - y * rows % 1))
    tone = rng.random((rows, rows))[row, u.astype(int) % (rows // 2)]
    return np.where(edge > 0.06, 0.25 + 0.5 * tone, 1.0)


def _planks(rng: Generator) -> NdArray:
    x = _grid()[0]
    n = int(rng.integers(3, 8))
    plank = (x * n).astype(int)
    grain = noise(rng, 2, 6)[np.arange(_SIZE) // 12 % _SIZE]
    lines = 0.5 + 0.5 * np.sin(2 * np.pi * (6 * n * x + 1.5 * grain + rng.random(n)[plank]))
    gap = np.minimum(x * n % 1, 1 - x * n % 1) > 0.02
    return np.where(gap, 0.35 + 0.3 * rng.random(n)[plank] + 0.25 * lines * noise(rng, 8, 3), 0.0)


def _marble(rng: Generator) -> NdArray:
    x, y = _grid()
    bent = 3 * noise(rng, 3, 6)
    return np.asarray(
        np.abs(np.sin(np.pi * (rng.integers(1, 4) * x + rng.integers(1, 4) * y + bent))) ** 0.5
    )


def _clouds(rng: Generator) -> NdArray:
    return np.clip(2.2 * (noise(rng, int(rng.integers(2, 7)), 6) - 0.5) + 0.5, 0, 1)


def _terrazzo(rng: Generator) -> NdArray:
    x, y = _grid()
    nearest, tone = np.full(x.shape, np.inf), np.zeros(x.shape)
    for _ in range(60):
        u, v, r, t = rng.random(4)
        dx, dy = np.abs(x[0] - u), np.abs(y[:, 0] - v)
        squares = np.minimum(dx, 1 - dx)[None] ** 2 + np.minimum(dy, 1 - dy)[:, None] ** 2
        away = squares / (0.022 + 0.035 * r) ** 2
        tone, nearest = np.where(away < nearest, t, tone), np.minimum(nearest, away)
    return np.where(nearest < 1, 0.3 + 0.7 * tone, 0.15)


def _weave(rng: Generator) -> NdArray:
    x, y = _grid()
    n = int(rng.integers(8, 20)) * 2
    over = ((x * n).astype(int) + (y * n).astype(int)) % 2 == 0
    across = np.where(over, x * n % 1, y * n % 1)
    return np.where(over, 0.55, 0.35) + 0.4 * np.sin(np.pi * across)


def _edge(inside: NdArray, width: float) -> NdArray:
    return _smooth(np.clip(inside / width + 0.5, 0, 1))


def _smooth(t: NdArray) -> NdArray:
    return np.asarray(t * t * (3 - 2 * t))


_KINDS: tuple[Callable[[Generator], NdArray], ...] = (
    *(_checks, _stripes, _dots, _bricks, _planks),
    *(_marble, _clouds, _terrazzo, _weave),
)
