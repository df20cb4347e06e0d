"""random_joints: the joints of robots, within their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ...errors import InvalidArgument
from ...robots.robot import Robots, listed
from ..draw import Draw
from .ranges import Range, checked_range, number


class RandomJoints:
    """Draws the values of the joints of a robot, or of several with the same joints.

    ranges: {name in robot.joint_names: Range}, radians or metres, within the joint's limits.
    Without one a joint is uniform within its limits, a continuous one over a full turn; any other
    joint without limits rests.
    """

    def __init__(self, robot: Robots, ranges: Mapping[str, Range] | None = None) -> None:
        self.robots = listed(robot)
        if not self.robots:
            raise InvalidArgument("robot: there is none", field="robot")
        kinematics = self.robots[0].kinematics
        turning = {joint.name for joint in kinematics.moving if joint.kind == "continuous"}
        self.ranges: list[Range] = []
        for name, (low, high), rest in zip(
            kinematics.joint_names, kinematics.limits.tolist(), kinematics.rest.tolist()
        ):
            given = (ranges or {}).get(name)
            if given is not None:
                self.ranges.append(checked_range(given, f"ranges[{name!r}]", low, high))
            elif name in turning:
                self.ranges.append((-math.pi, math.pi))
            else:
                self.ranges.append((low, high) if math.isfinite(high - low) else rest)
        for name in ranges or {}:
            if name not in kinematics.joint_names:
                have = ", ".join(kinematics.joint_names)
                raise InvalidArgument(
                    f"ranges: {name!r} is no joint with a value; there are {have}", field="ranges"
                )

    def __call__(self, draw: Draw) -> None:
        for robot in self.robots:
            draw.set_joints(robot, np.array([number(draw.rng, each) for each in self.ranges]))

    def __repr__(self) -> str:
        return f"random_joints({', '.join(robot.name for robot in self.robots)})"
