"""Values of joints from poses. Used by articulations.py."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .._wire.arrays import NdArray
from ..values.pose import rotation_of_wxyz
from .joints import Freedom

Value = tuple[float, ...]  # radians or metres, or a quaternion w x y z


def values_of(freedoms: Sequence[Freedom], pose: NdArray) -> list[Value]:
    """Values that bring a joint nearest to a pose (4, 4), first_from_second; angles lie between the
    limits, if a whole turn more or less does it."""
    turns = [one for one in freedoms if one.kind in ("revolute", "continuous")]
    angles = iter(_angles(turns, pose[:3, :3]))
    found: list[Value] = []
    for one in freedoms:
        if one.kind == "prismatic":
            found.append((float(pose[:3, 3] @ one.axis),))
        elif one.kind == "spherical":
            found.append(_quaternion(pose[:3, :3]))
        else:
            found.append((_within(next(angles), one),))
    return found


def moved(freedoms: Sequence[Freedom], values: Sequence[Value]) -> NdArray:
    """(4, 4) first_from_second of a joint at values."""
    out = np.eye(4)
    for one, value in zip(freedoms, values):
        out = out @ step(one, value)
    return out


def step(one: Freedom, value: Value) -> NdArray:
    """(4, 4) of one freedom at its value."""
    out = np.eye(4)
    if one.kind == "prismatic":
        out[:3, 3] = value[0] * one.axis
    elif one.kind == "spherical":
        out[:3, :3] = rotation_of_wxyz(np.array(value))
    else:
        half = 0.5 * value[0]
        out[:3, :3] = rotation_of_wxyz(np.array([math.cos(half), *(math.sin(half) * one.axis)]))
    return out


def _angles(turns: Sequence[Freedom], rotation: NdArray) -> list[float]:
    """Angles, radians: of one turn about its axis; of several about X, then Y, then Z."""
    if len(turns) == 1:
        w, *v = _quaternion(rotation)
        return [2 * math.atan2(float(np.dot(v, turns[0].axis)), w)]
    r = rotation
    about = {
        0: math.atan2(-r[1, 2], r[2, 2]),
        1: math.asin(min(max(r[0, 2], -1.0), 1.0)),
        2: math.atan2(-r[0, 1], r[0, 0]),
    }
    return [about[int(one.axis.argmax())] for one in turns]


def _within(angle: float, one: Freedom) -> float:
    angle = math.remainder(angle, 2 * math.pi)
    for turned in (angle, angle + 2 * math.pi, angle - 2 * math.pi):
        if one.lower - 1e-6 <= turned <= one.upper + 1e-6:
            return turned
    return angle


def _quaternion(rotation: NdArray) -> Value:
    """w x y z, of length 1: the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)."""
    r = rotation
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    products = np.empty((4, 4))
    products[0, 0] = np.trace(r)
    products[0, 1:] = products[1:, 0] = skew
    products[1:, 1:] = r + r.T - np.trace(r) * np.eye(3)
    q = np.linalg.eigh(products)[1][:, -1]
    return tuple((q * (1 if q[0] >= 0 else -1)).tolist())
