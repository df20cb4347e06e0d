"""Rays of a camera that has one for each pixel. Made by Camera.from_rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._wire.arrays import NdArray, checked


@dataclass(frozen=True, eq=False)
class RayTable:
    """rays: (H, W, 6) float32, times: (H, W) float32 or None. See Camera.from_rays."""

    rays: NdArray
    times: NdArray | None = None
    interpolated: bool = False

    @classmethod
    def of(cls, rays: Any, times: Any, interpolated: bool) -> RayTable:
        """Checks shapes and numbers."""
        table = checked(rays, "rays", "<f4", (None, None, 6))
        if times is not None:
            times = checked(times, "times", "<f4", table.shape[:2])
        return cls(table, times, bool(interpolated))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RayTable):
            return NotImplemented
        same = self.interpolated == other.interpolated and np.array_equal(self.rays, other.rays)
        if self.times is None or other.times is None:
            return same and self.times is other.times
        return same and np.array_equal(self.times, other.times)

    __hash__ = None  # type: ignore[assignment]
