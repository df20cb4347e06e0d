"""Context of the readers of a stage: its time, its options, its notes. Needs pxr."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from .._wire.arrays import NdArray
from .files import Files
from .model import Model, Options, Pose

_THIN = 1e-5
_FRAMES = 100_000  # whole codes between the samples of one prim that become keys


@dataclass
class Context:
    """Context of one reading of one stage."""

    stage: Any
    options: Options
    model: Model
    files: Files
    time: Any = field(init=False)  # Usd.TimeCode of still attributes
    up: NdArray = field(init=False)  # (4, 4) root_from_stage

    def __post_init__(self) -> None:
        self.time = Usd.TimeCode.EarliestTime()
        if self.options.time is not None:
            self.time = Usd.TimeCode(self.code(self.options.time))
        turn = [[1, 0, 0], [0, 0, -1], [0, 1, 0]] if self.model.up == "y" else np.eye(3)
        self.up = np.eye(4)
        self.up[:3, :3] = self.model.metres_per_unit * np.asarray(turn)

    def note(self, prim: Any, text: str) -> None:
        self.model.notes.add(prim, text)

    def value(self, attribute: Any) -> Any:
        """Value of an attribute at `time`; None without one."""
        return attribute.Get(self.time) if attribute else None

    def number(self, attribute: Any, default: float = 0.0) -> float:
        """Finite number of an attribute; any other is noted and replaced by the default."""
        found = self.value(attribute)
        if found is None:
            return default
        if not math.isfinite(found):
            self.note(
                attribute.GetPrim(), f"{attribute.GetName()} is not finite; {default:g} taken"
            )
            return default
        return float(found)

    # ------------------------------------------------------------ time

    def code(self, seconds: float) -> float:
        return float(seconds * self.stage.GetTimeCodesPerSecond())

    def seconds(self, code: float) -> float:
        return float(code / self.stage.GetTimeCodesPerSecond())

    def codes(self, samples: Sequence[float], steps: bool = True) -> list[float]:
        """Time codes of the keys for an attribute with these samples; fewer than 2: it stands
        still.

        steps: whole codes between the samples count too, as frames do, so that turns stay whole.
        """
        times = self.options.times
        if times is None or len(samples) < 2:
            return []
        if isinstance(times, str):  # "all"
            first, last = math.ceil(samples[0]), math.floor(samples[-1])
            between = range(first, last) if steps and last - first <= _FRAMES else range(0)
            return sorted({*map(float, samples), *map(float, between)})
        return sorted({self.code(t) for t in times})

    # ------------------------------------------------------------ poses

    def pose(self, xformable: Any, at_root: bool) -> Pose:
        """parent_from_local of a prim, or root_from_local where there is no node above."""
        codes = self.codes(xformable.GetTimeSamples())
        if len(codes) < 2:
            if xformable.TransformMightBeTimeVarying() and self.options.times is None:
                self.note(xformable, 'it moves, and is taken as at one time: give times="all"')
            return self._matrix(xformable, self.time, at_root)
        return {self.seconds(c): self._matrix(xformable, Usd.TimeCode(c), at_root) for c in codes}

    def _matrix(self, xformable: Any, time: Any, at_root: bool) -> NdArray:
        local = matrix_of(xformable.GetLocalTransformation(time))
        if not np.isfinite(local).all():
            self.note(xformable, "its transform is not finite; the identity taken")
            local = np.eye(4)
        return self.up @ self.thick(xformable, local) if at_root else self.thick(xformable, local)

    def thick(self, prim: Any, matrices: NdArray) -> NdArray:
        """(..., 4, 4) whose axes all have a length, be it one that nobody sees."""
        u, sizes, v = np.linalg.svd(matrices[..., :3, :3])
        if not (sizes[..., 2] <= _THIN * sizes[..., 0]).any():
            return matrices
        self.note(prim, f"an axis of its transform has no length: {_THIN:g} taken")
        least = _THIN * np.maximum(1.0, sizes[..., :1])
        out = matrices.copy()
        out[..., :3, :3] = (u * np.maximum(sizes, least)[..., None, :]) @ v
        return out

    def world(self, prim: Any) -> NdArray:
        """(4, 4) root_from_local at `time`."""
        return self.up @ matrix_of(UsdGeom.XformCache(self.time).GetLocalToWorldTransform(prim))


def matrix_of(matrix: Any) -> NdArray:
    """(4, 4) float64 for column vectors of a Gf.Matrix4d, which is for rows."""
    return np.array(matrix, dtype="f8").T
