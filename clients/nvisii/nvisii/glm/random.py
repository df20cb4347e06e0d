"""GLM's random numbers; numpy's generator, whose seed numpy.random.seed() sets."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .elementwise import like, numbers
from .vectors import Numbers, vec2, vec3


def linearRand(Min: Numbers, Max: Numbers) -> Any:
    """Uniform between two numbers or vectors."""
    low, high = numbers(Min), numbers(Max)
    return like(np.asarray(low + (high - low) * np.random.random_sample(low.shape)), (Min, Max))


def gaussRand(Mean: Numbers, Deviation: Numbers) -> Any:
    """Normal."""
    mean, deviation = numbers(Mean), numbers(Deviation)
    return like(np.asarray(mean + deviation * np.random.standard_normal(mean.shape)), (Mean,))


def circularRand(Radius: float) -> Any:
    """Random point of a circle about the origin, vec2."""
    angle = np.random.random_sample() * 2 * math.pi
    return vec2(Radius * math.cos(angle), Radius * math.sin(angle))


def diskRand(Radius: float) -> Any:
    """Within a circle, vec2."""
    return circularRand(Radius * math.sqrt(np.random.random_sample()))


def sphericalRand(Radius: float) -> Any:
    """Random point of a sphere about the origin, vec3."""
    z = 2 * np.random.random_sample() - 1
    x, y = circularRand(Radius * math.sqrt(max(0.0, 1 - z * z)))
    return vec3(x, y, Radius * z)


def ballRand(Radius: float) -> Any:
    """Within a sphere, vec3."""
    return sphericalRand(Radius * float(np.cbrt(np.random.random_sample())))
