"""Puts the entities of robots: of URDF files, and the part that mjcf/ shares. Used by robot.py."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidArgument
from ..scene import patches
from ..scene.handles import Entity, Group, Material
from ..values.checks import refuse_unknown
from .description import Look, Visual

if TYPE_CHECKING:
    from ..client.edit import Edits
    from .robot import Robot

_SEEN = 0.5  # the least opacity that labels take for a surface


class Builder(ABC):
    """Puts the entities of one robot."""

    def __init__(self, edits: Edits, robot: Robot) -> None:
        self.edits = edits
        self.robot = robot
        self.model = robot.model
        self.library = robot.library

    def build(self, keypoints: Sequence[str] | None, components: patches.Components) -> Robot:
        """keypoints: names of joints, None for all."""
        robot = self.robot
        refuse_unknown(components, patches.Components, "an entity")
        self._choose_keypoints(keypoints)
        self._put_root(components)
        local = dict(
            zip(
                (joint.child for joint in robot.kinematics.moving),
                robot.kinematics.local(robot.kinematics.rest),
            )
        )
        above = {joint.child: joint for joint in self.model.joints}
        for link, part in robot.parts.items():
            joint = above.get(link)
            given = self._link_components(link)
            given["parent"] = robot.links[joint.parent] if joint else robot.root
            given["transform"] = local.get(link, joint.origin if joint else np.eye(4))
            robot.links[link] = self.edits.entity(f"{robot.name}/{link}", exist_ok=False, **given)
            for number, visual in enumerate(self.model.visuals[link]):
                name = f"{robot.name}/{link}/{number}"
                self._put_visual(visual, name, (robot.links[link], part))
        robot.moving = Group([robot.links[j.child] for j in robot.kinematics.moving])
        self._put_keypoints()
        robot.warnings.extend(self.library.warnings)
        return robot

    def _put_root(self, components: patches.Components) -> None:
        given: Any = {"label": "auto", **components}
        if self.robot.skeleton:
            own = {"skeleton": json.dumps(self.robot.skeleton)}
            given["attributes"] = {**own, **(components.get("attributes") or {})}
        self.robot.root = self.edits.entity(self.robot.name, exist_ok=False, **given)

    def _link_components(self, link: str) -> patches.Components:
        """Components of a link's entity besides its pose."""
        return {}

    @abstractmethod
    def _put_visual(self, visual: Any, name: str, link: tuple[Entity, int]) -> None:
        """Puts one of model.visuals beneath its link. link: the entity, and the number of its
        part."""

    # ------------------------------------------------------------ keypoints

    def _choose_keypoints(self, wanted: Sequence[str] | None) -> None:
        robot = self.robot
        joints = {joint.name: joint for joint in self.model.joints}
        for name in wanted or ():
            if name not in joints:
                have = ", ".join(joints)
                raise InvalidArgument(
                    f"keypoints: there is no joint {name!r}; it has {have}", field="keypoints"
                )
        above = {joint.child: joint for joint in self.model.joints}
        robot.keypoints = [name for name in joints if wanted is None or name in wanted]
        for name in robot.keypoints:
            up = above.get(joints[name].parent)
            while up is not None and up.name not in robot.keypoints:
                up = above.get(up.parent)
            if up is not None:
                robot.skeleton.append((up.name, name))

    def _put_keypoints(self) -> None:
        """A keypoint lives in a mesh: a triangle without area in the origin of the joint."""
        below = {joint.name: joint.child for joint in self.model.joints}
        for name in self.robot.keypoints:
            link = self.robot.links[below[name]]
            if name not in self.library.keypoints:
                self.library.keypoints[name] = self.edits.mesh(
                    f"{link.name}/keypoint/mesh",
                    positions=np.zeros((3, 3)),
                    indices=[[0, 1, 2]],
                    keypoints={name: (0, 0, 0)},
                )
            mesh = self.library.keypoints[name]
            part = self.robot.parts[below[name]]
            self.edits.entity(f"{link.name}/keypoint", parent=link, mesh=mesh, part=part)


@dataclass(frozen=True)
class Options:
    """Options of import_urdf()."""

    packages: Mapping[str, str | os.PathLike[str]]
    mesh_materials: bool
    strict: bool


class UrdfBuilder(Builder):
    """Puts the entities of a robot of a URDF file."""

    def __init__(self, edits: Edits, robot: Robot, options: Options) -> None:
        super().__init__(edits, robot)
        self.options = options

    def _put_visual(self, visual: Visual, name: str, link: tuple[Entity, int]) -> None:
        parent, part = link
        material = None if visual.look is None else self._material(visual.look)
        given: Any = {} if material is None else {"material": material}
        if visual.file is None:
            self._warn_if_hidden(visual, parent)
            given["mesh"] = self.library.mesh(self.edits, visual, name)
            at = visual.origin
            self.edits.entity(name, exist_ok=False, parent=parent, transform=at, part=part, **given)
            return
        asset = self.library.asset(self.edits, visual.file, name, self.options.strict)
        if asset is None:
            return
        overrides = {}
        if material is not None and not self.options.mesh_materials:
            overrides = dict.fromkeys(asset.materials, material)
        if overrides or not asset.materials:
            self._warn_if_hidden(visual, parent)
        pose = visual.origin @ np.diag([*visual.size, 1.0])
        root = self.edits.instance(asset, name, transform=pose, parent=parent, materials=overrides)
        self.edits.update(root, label=None)  # that of the robot
        given = {} if asset.materials else given
        for entity in asset._placed[-1]:
            self.edits.update(entity, part=part, **given)

    def _material(self, look: Look) -> Material:
        return self.library.material(self.edits, look, self.robot.name, self.options.strict)

    def _warn_if_hidden(self, visual: Visual, link: Entity) -> None:
        look = visual.look
        alpha = look.color[3] if look is not None and look.color is not None else 1.0
        if alpha < _SEEN:
            text = f"{link.name}: of alpha {alpha:g}, labels show what is behind it"
            if text not in self.robot.warnings:
                self.robot.warnings.append(text)
