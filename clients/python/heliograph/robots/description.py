"""A robot as its file describes it: links, joints and visuals. Made by urdf.py and mjcf/."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .._wire.arrays import NdArray

ONE_AXIS = ("revolute", "continuous", "prismatic")
KINDS = (*ONE_AXIS, "fixed", "floating", "planar", "spherical")


@dataclass(frozen=True)
class Look:
    """A material: color RGBA as it is shown (sRGB), and the file of a texture."""

    name: str
    color: tuple[float, ...] | None = None
    texture: Path | None = None


@dataclass(frozen=True, eq=False)
class Visual:
    """Visual of a link. shape: "box" (x, y, z), "cylinder" and "capsule" (radius, length), "sphere"
    (radius,) or "mesh" (scale in x, y, z), metres. origin: (4, 4) link_from_visual."""

    shape: str
    size: tuple[float, ...]
    origin: NdArray
    file: Path | None = None
    look: Look | None = None


@dataclass(frozen=True)
class Mimic:
    """value = multiplier * value of `joint` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """kind: of KINDS; MuJoCo's ball is "spherical". origin: (4, 4) parent_from_joint. axis: (3,)
    unit, in the joint's frame. lower, upper: radians or metres. rest: the values that it is
    imported with, () for 0 or no rotation; at that value a joint of one axis is in its origin."""

    name: str
    kind: str
    parent: str
    child: str
    origin: NdArray
    axis: NdArray
    lower: float = -math.inf
    upper: float = math.inf
    mimic: Mimic | None = None
    rest: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class RobotModel:
    """links: names, parents first; visuals: by link, as the file's reader has them; joints in the
    file's order; roots: folders whose files may be read; soft_limits: values may be beyond the
    limits; keyframes: (C,) values by name, in the order of Kinematics.joint_names."""

    name: str
    links: list[str]
    visuals: Mapping[str, Sequence[Any]]
    joints: list[Joint]
    roots: list[Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    soft_limits: bool = False
    keyframes: Mapping[str, NdArray] = field(default_factory=dict)
