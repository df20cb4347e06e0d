"""Models of a BOP data set: models_info.json and obj_*.ply. Used by bop.py."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import NUMBER, fields_of, numbers, read_object
from .geometry import rotation_fault
from .ply import vertices
from .report import Faults

_SIZES = [f"{what}_{axis}" for what in ("min", "size") for axis in "xyz"]
_INFO = {**dict.fromkeys(_SIZES, NUMBER), "diameter": NUMBER}
_MANY = 5000  # vertices; of more, the outermost in some direction suffice


@dataclass(frozen=True)
class Model:
    """points: (N, 3) mm, the outermost vertices. radius: the farthest one's distance."""

    points: NdArray
    radius: float


def read_models(folder: Path, faults: Faults) -> dict[int, Model]:
    """obj_id to model. Adds their faults."""
    models = {}
    for key, info in read_object(folder / "models_info.json").items():
        number = int(key)
        path = folder / f"obj_{number:06d}.ply"
        wrong = fields_of(info, _INFO)
        if wrong:
            faults.add("format", folder / "models_info.json", f"model {key} {wrong}")
            continue
        if not path.is_file():
            faults.add("models", path, f"is not there, and models_info.json has {key}: write it")
            continue
        points = vertices(path)
        _check_sizes(path, points, info, faults)
        _check_symmetries(folder / "models_info.json", number, info, faults)
        models[number] = Model(_outermost(points), float(np.linalg.norm(points, axis=1).max()))
    return models


def _check_sizes(path: Path, points: NdArray, info: dict[str, Any], faults: Faults) -> None:
    low, size = points.min(0), np.ptp(points, axis=0)
    stated_low, stated_size = (
        np.array([info[f"{what}_{axis}"] for axis in "xyz"], float) for what in ("min", "size")
    )
    diameter, longest = float(info["diameter"]), float(np.linalg.norm(size))
    within = 1e-3 * longest + 1e-3
    ratio = np.linalg.norm(stated_size) / max(longest, 1e-12)
    if not 1 / 30 < ratio < 30:
        faults.add(
            "units",
            path,
            f"its vertices span {size.round(4).tolist()}, models_info.json has "
            f"{stated_size.round(4).tolist()}: both are mm",
        )
    elif max(np.abs(low - stated_low).max(), np.abs(size - stated_size).max()) > within:
        faults.add(
            "models",
            path,
            f"its vertices start at {low.round(3).tolist()} and span {size.round(3).tolist()}, "
            "models_info.json has "
            f"{stated_low.round(3).tolist()}, {stated_size.round(3).tolist()}",
        )
    elif np.abs(low + size / 2).max() > 0.01 * longest + 1e-3:
        faults.add(
            "models",
            path,
            f"its box's centre is {(low + size / 2).round(3).tolist()}: a model's origin is there",
        )
    if not size.max() - within <= diameter <= longest + within and 1 / 30 < ratio < 30:
        faults.add(
            "models",
            path,
            f"diameter is {diameter:g}: the largest distance of two vertices is between "
            f"{size.max():g} and {longest:g}",
        )


def _check_symmetries(path: Path, number: int, info: dict[str, Any], faults: Faults) -> None:
    for row in info.get("symmetries_discrete", ()):
        if not numbers(16).holds(row):
            faults.add("models", path, f"model {number}: a discrete symmetry has 16 numbers")
            continue
        matrix = np.reshape(row, (4, 4))
        wrong = rotation_fault(matrix[:3, :3])
        if wrong or list(matrix[3]) != [0, 0, 0, 1]:
            faults.add(
                "models",
                path,
                f"model {number}: a discrete symmetry {wrong or 'ends in ' + str(list(matrix[3]))}"
                ": it is a 4x4 rigid transform by rows",
            )
    for row in info.get("symmetries_continuous", ()):
        wrong = fields_of(row, {"axis": numbers(3), "offset": numbers(3)})
        if wrong or abs(np.linalg.norm(row["axis"]) - 1) > 1e-3:
            faults.add(
                "models",
                path,
                f"model {number}: a continuous symmetry {wrong or 'has an axis that is no unit'}",
            )


def _outermost(points: NdArray) -> NdArray:
    """Points that are farthest in one of 4096 directions (a Fibonacci sphere), of many points."""
    if len(points) <= _MANY:
        return points
    i = np.arange(4096) + 0.5
    z, turn = 1 - 2 * i / 4096, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    rows = {int((points @ direction).argmax()) for direction in directions}
    return np.asarray(points[sorted(rows)])
