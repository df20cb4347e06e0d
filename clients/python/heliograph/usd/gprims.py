"""Cubes, spheres, cylinders, cones, capsules and planes to meshes. Needs pxr."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray
from ..values import shapes
from .context import Context

if TYPE_CHECKING:
    from ..scene.patches import Geometry

_SEGMENTS = 64
_TURNS = {  # columns: where x, y and z of a shape along +Z go
    "X": np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], "f4"),
    "Y": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], "f4"),
    "Z": np.eye(3, dtype="f4"),
}


def geometry(context: Context, prim: Any) -> Geometry | None:
    """The mesh of a Gprim that is no mesh; None: it is left out (noted)."""
    make = _SHAPES.get(str(prim.GetTypeName()))
    if make is None:
        context.note(prim, f"{prim.GetTypeName()} is left out")
        return None

    def size(name: str, default: float) -> float:
        return context.number(prim.GetAttribute(name), default)

    for attribute in prim.GetAttributes():
        if attribute.GetNumTimeSamples() > 1 and not attribute.GetName().startswith("xformOp"):
            context.note(prim, f"{attribute.GetName()} changes, and is taken as at one time")
    axis = str(context.value(prim.GetAttribute("axis")) or "Z")
    swapped = make is _plane and axis != "Z"
    out = _plane(size, ("length", "width")) if swapped else make(size)
    extent = np.abs(np.asarray(out["positions"])).max()
    if axis not in _TURNS or not extent > 0:
        context.note(prim, "a shape without a size is left out")
        return None
    return _turned(out, _TURNS[axis])


def _turned(shape: Geometry, turn: NdArray) -> Geometry:
    out: Geometry = {**shape}
    for name in ("positions", "normals"):
        out[name] = np.asarray(shape[name]) @ turn.T
    return out


_Size = Callable[[str, float], float]


def _plane(size: _Size, along: tuple[str, str] = ("width", "length")) -> Geometry:
    """Rectangle. along: its x and y; planes across X and Y have Y and Z, Z and X for them."""
    out = shapes.plane()
    scale = np.array([size(along[0], 2.0), size(along[1], 2.0), 1], "f4")
    out["positions"] = np.asarray(out["positions"]) * scale
    return out


def _revolved(rows: list[tuple[float, float, float, float]]) -> Geometry:
    """Surface of revolution from rows (radius, z, and the normal's share outwards and upwards),
    from the bottom up; two rows in one place make a sharp edge."""
    around = np.linspace(0, 2 * math.pi, _SEGMENTS + 1)
    ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
    table = np.array(rows)
    grid = table[:, None, :]
    positions = np.concatenate(
        [grid[..., :1] * ring, np.broadcast_to(grid[..., 1:2], (len(rows), len(ring), 1))], axis=-1
    )
    normals = np.concatenate(
        [grid[..., 2:3] * ring, np.broadcast_to(grid[..., 3:4], (len(rows), len(ring), 1))], axis=-1
    )
    u, v = np.meshgrid(np.linspace(0, 1, len(ring)), np.linspace(0, 1, len(rows)))
    return shapes.grid_surface(positions, normals, (u, v))


def _cone(size: _Size) -> Geometry:
    radius, half = size("radius", 1.0), 0.5 * size("height", 2.0)
    slope = math.hypot(radius, 2 * half) or 1.0
    out, up = 2 * half / slope, radius / slope
    base = [(0, -half, 0, -1), (radius, -half, 0, -1)]
    return _revolved([*base, (radius, -half, out, up), (0, half, out, up)])


def _cylinder(size: _Size) -> Geometry:
    radius, half = size("radius", 1.0), 0.5 * size("height", 2.0)
    base = [(0, -half, 0, -1), (radius, -half, 0, -1)]
    top = [(radius, half, 0, 1), (0, half, 0, 1)]
    return _revolved([*base, (radius, -half, 1, 0), (radius, half, 1, 0), *top])


def _capsule(size: _Size) -> Geometry:
    radius, half = size("radius", 0.5), 0.5 * size("height", 1.0)
    angles = np.linspace(0, math.pi / 2, _SEGMENTS // 4 + 1)
    upper = [(radius * c, half + radius * s, c, s) for c, s in zip(np.cos(angles), np.sin(angles))]
    lower = [(r, -z, c, -s) for r, z, c, s in reversed(upper)]
    return _revolved([*lower, *upper])


_SHAPES: dict[str, Callable[[_Size], Any]] = {
    "Cube": lambda size: shapes.cube(size("size", 2.0)),
    "Sphere": lambda size: shapes.sphere(size("radius", 1.0), _SEGMENTS),
    "Cylinder": _cylinder,
    "Cone": _cone,
    "Capsule": _capsule,
    "Plane": _plane,
}
