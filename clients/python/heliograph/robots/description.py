"""A robot as its file describes it: links, joints and what is to be seen of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

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
    """What is to be seen of a link. shape: "box" (x, y, z), "cylinder" and "capsule" (radius,
    length), "sphere" (radius,) or "mesh" (scale in x, y, z). origin: (4, 4) link_from_visual."""

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
    """origin: (4, 4) parent_from_joint. axis: (3,) unit, in the joint's frame. lower, upper:
    radians or metres."""

    name: str
    kind: str
    parent: str
    child: str
    origin: NdArray
    axis: NdArray
    lower: float = -math.inf
    upper: float = math.inf
    mimic: Mimic | None = None


@dataclass(frozen=True, eq=False)
class Urdf:
    """links: names, parents first; joints in the file's order; roots: folders whose files may be
    read."""

    name: str
    links: list[str]
    visuals: dict[str, list[Visual]]
    joints: list[Joint]
    roots: list[Path]
    warnings: list[str] = field(default_factory=list)
