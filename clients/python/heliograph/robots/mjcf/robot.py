"""Robot of an MJCF file, and the state that its copies share. Made by edits.py; docs/mjcf.md."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..._wire.arrays import NdArray
from ...errors import InvalidArgument
from ...scene.handles import Entity, Mesh
from ..description import RobotModel
from ..robot import Robot
from .geometry import Shape
from .looks import Looks
from .reading import Compiled, at_values, camera_at

if TYPE_CHECKING:
    from ...client.scene import Scene


@dataclass
class Shared:
    """State that all copies of one file share."""

    source: Compiled
    looks: Looks
    meshes: dict[Shape, Mesh] = field(default_factory=dict)


class MjcfRobot(Robot):
    """A Robot of an MJCF file: its values are MuJoCo's qpos, C = nq, in the same order.

    keyframes: (C,) values by the keyframe's name.
    instances: the uppermost link of each body that is beneath the world, by the body's name.
    geoms, cameras, lights, sites, tendons, skins: entities by MuJoCo's names; unnamed ones by their
    kind and number: "geom3".
    """

    def __init__(self, scene: Scene, name: str, model: RobotModel, shared: Shared) -> None:
        super().__init__(scene, name, model)
        self.shared = shared
        self.keyframes: dict[str, NdArray] = dict(model.keyframes)
        self.instances: dict[str, Entity] = {}
        self.geoms: dict[str, Entity] = {}
        self.cameras: dict[str, Entity] = {}
        self.lights: dict[str, Entity] = {}
        self.sites: dict[str, Entity] = {}
        self.tendons: dict[str, Entity] = {}
        self.skins: dict[str, Entity] = {}

    def camera_pose(self, name: str, values: Any) -> NdArray:
        """(4, 4) float64 root_from_camera at the values (C,) of its joints, as MuJoCo has it: for
        cameras that track or target a body, which do not move by themselves.
        InvalidArgument: there is no such camera."""
        if name not in self.cameras:
            have = ", ".join(self.cameras) or "none"
            raise InvalidArgument(f"name: there is no camera {name!r}; it has {have}", field="name")
        data = at_values(self.shared.source.model, self.kinematics.values(values))
        return camera_at(data, list(self.cameras).index(name))
