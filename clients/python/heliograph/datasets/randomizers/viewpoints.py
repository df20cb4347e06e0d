"""orbit, look_at_jitter, camera_path: where cameras are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ...scene.handles import flatten
from ...values.pose import look_at
from ..bodies import middle
from . import ranges
from .ranges import Range

if TYPE_CHECKING:
    from ..draw import Draw

_RIGHT_ANGLE = math.pi / 2 + 1e-6


class Orbit:
    """Puts a camera on a sphere about a target and looks at its middle.

    camera: an entity; several share the point that they look at. target: entities, whose world box
    has the middle, or a point (3,). distance: metres to it. elevation: radians above the horizon;
    a pair is uniform by area on the sphere. azimuth: radians about +Z from +X. roll: radians about
    the optical axis.
    """

    def __init__(
        self,
        camera: Any,
        target: Any,
        *,
        distance: Range,
        elevation: Range = (0.25, 1.3),
        azimuth: Range = (0.0, 2 * math.pi),
        roll: Range = 0.0,
    ) -> None:
        self.camera, self.target = camera, target
        self.distance = ranges.checked_range(distance, "distance", 1e-9)
        self.elevation = ranges.checked_range(elevation, "elevation", -_RIGHT_ANGLE, _RIGHT_ANGLE)
        self.azimuth = ranges.checked_range(azimuth, "azimuth")
        self.roll = ranges.checked_range(roll, "roll")

    def __call__(self, draw: Draw) -> None:
        target = middle(draw, self.target)
        cameras = flatten(self.camera, "camera")
        poses = []
        for _ in cameras:
            way = ranges.direction(draw.rng, self.elevation, self.azimuth)
            pose = look_at(target + ranges.number(draw.rng, self.distance) * way, target)
            poses.append(_rolled(pose, ranges.number(draw.rng, self.roll)))
        draw.place(cameras, poses)


class LookAtJitter:
    """Turns a camera, from where it is, to a point near the target's middle.

    target: as of Orbit. offset: metres; the point is uniform in the ball of that radius about the
    middle. roll: radians about the optical axis.
    """

    def __init__(
        self, camera: Any, target: Any, *, offset: float, roll: Range = (-0.1, 0.1)
    ) -> None:
        self.camera, self.target = camera, target
        self.offset = ranges.checked_number(offset, "offset", 0)
        self.roll = ranges.checked_range(roll, "roll")

    def __call__(self, draw: Draw) -> None:
        target = middle(draw, self.target)
        cameras = flatten(self.camera, "camera")
        poses = []
        for camera in cameras:
            at = target + ranges.in_ball(draw.rng, self.offset)
            pose = look_at(draw.pose(camera)[:3, 3], at)
            poses.append(_rolled(pose, ranges.number(draw.rng, self.roll)))
        draw.place(cameras, poses)


def _rolled(pose: Any, angle: float) -> Any:
    out = pose.copy()
    out[:3, :3] = pose[:3, :3] @ ranges.turn(np.array([0.0, 0.0, 1.0]), angle)
    return out
