"""Camera pose so that a box fills its picture. Used by the command line and examples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._wire.arrays import NdArray, checked
from .components import Camera
from .pose import look_at

_MARGIN = 1.08


def corners_of(bounds: Any) -> NdArray:
    """(8, 3) corners of a (2, 3) box."""
    box = checked(bounds, "bounds", "f8", (2, 3))
    return np.array(
        [[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )


def frame_box(
    bounds: Any, camera: Camera, *, azimuth: float = 35.0, elevation: float = 18.0
) -> NdArray:
    """(4, 4) pose of `camera` that looks at the middle of a (2, 3) box, just far enough away to
    see all of it. Degrees: azimuth from the front (-Y) towards +X, elevation above the horizon."""
    corners = corners_of(bounds)
    middle = corners.mean(axis=0)
    a, e = math.radians(azimuth), math.radians(elevation)
    away = np.array([math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)])
    turned = look_at(middle + away, middle)
    local = (corners - middle) @ turned[:3, :3]  # in camera axes; z towards the camera
    reach = np.array(
        [
            min(camera.cx + 0.5, camera.width - camera.cx - 0.5) / camera.fx,
            min(camera.cy + 0.5, camera.height - camera.cy - 0.5) / camera.fy,
        ]
    )
    needed = np.abs(local[:, :2]) * _MARGIN / reach + local[:, 2:3]
    distance = max(float(needed.max()), 1e-6)
    return look_at(middle + away * distance, middle)
