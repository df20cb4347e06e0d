"""Robots of USD stages: bodies that joints connect. Made by build.py; docs/usd.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .._wire.arrays import NdArray
from ..robots.building import Builder
from ..robots.robot import Robot
from ..scene.handles import Entity

if TYPE_CHECKING:
    from ..client.scene import Scene
    from ..robots._library import Library
    from .model import Articulation


class UsdRobot(Robot):
    """A Robot of a USD stage: its links are the bodies that joints connect.

    bodies: the link's name by the path of the prim. keyframes: (C,) values by name; "targets" are
    the targets of the stage's drives.
    """

    def __init__(
        self, scene: Scene, name: str, found: Articulation, library: Library | None
    ) -> None:
        super().__init__(scene, name, found.robot, library)
        self.bodies = {path: link for path, (link, _) in found.bodies.items()}
        self.keyframes: dict[str, NdArray] = {}
        if found.targets:
            values = self.rest
            for joint, value in found.targets.items():
                if joint in self.joint_names:
                    values[self.joint_names.index(joint)] = value
            self.keyframes["targets"] = values


class RobotBuilder(Builder):
    """Puts the links; their visuals are put like the rest of the stage."""

    def _put_visual(self, visual: Any, name: str, link: tuple[Entity, int]) -> None:
        raise AssertionError("a stage's bodies have no visuals of their own")


def components_of(given: Mapping[str, Any], found: Articulation, above: Entity) -> dict[str, Any]:
    """Components of a robot's root: its pose, and its instance as the call or the stage has it."""
    own = {n: given[n] for n in ("label", "category", "group", "attributes") if n in given}
    if found.category:
        own.update(category=found.category, label="auto")
    return {**own, "parent": above, "transform": found.pose}
