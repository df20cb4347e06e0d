"""Puts the entities of an MJCF file. Used by edits.py."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from ...scene import patches
from ...scene.handles import Entity, Mesh
from ..building import Builder
from . import fittings, lights, surfaces
from .geometry import Shape, geometry
from .looks import Looks
from .reading import WORLD, body_names, compiled, robot_model
from .robot import MjcfRobot, Shared
from .surfaces import Surface

if TYPE_CHECKING:
    from ...client.edit import Edits

_OF_INSTANCES = ("label", "category", "group", "attributes")


@dataclass(frozen=True)
class Wanted:
    """Options of import_mjcf()."""

    groups: Sequence[int]
    sites: bool
    lights: bool
    size: tuple[int, int]
    keypoints: Sequence[str] | None


def placed(
    edits: Edits, path: Any, name: str | None, wanted: Wanted, components: patches.Components
) -> MjcfRobot:
    """Places a robot, as import_mjcf() describes."""
    if isinstance(path, MjcfRobot):
        shared, prefix = path.shared, name or path.name
    else:
        source = compiled(path)
        prefix = name or source.name
        shared = Shared(source, Looks(source, prefix, []))
    visuals = surfaces.by_body(shared.source, wanted.groups, wanted.sites)
    model = robot_model(shared.source, visuals)
    robot = MjcfRobot(edits.scene, prefix, model, shared)
    return MjcfBuilder(edits, robot, wanted).put(components)


class MjcfBuilder(Builder):
    """Puts the entities of one file."""

    robot: MjcfRobot

    def __init__(self, edits: Edits, robot: MjcfRobot, wanted: Wanted) -> None:
        super().__init__(edits, robot)
        self.wanted = wanted
        self.shared = robot.shared
        self.source = robot.shared.source
        self.bodies = body_names(self.source)
        self.names = {f"{robot.name}/{link}" for link in robot.model.links}
        self.of_instances: dict[str, Any] = {}
        self.above = {joint.child: joint.parent for joint in robot.model.joints}

    def put(self, components: patches.Components) -> MjcfRobot:
        robot, source = self.robot, self.source
        self.build(self._keypoints(), components)
        robot.warnings += surfaces.hidden(source, self.wanted.groups, self.wanted.sites)
        robot.instances = {body: robot.links[link] for body, link in self._tops().items()}
        fittings.put(self, self.wanted.groups)
        lights.put_cameras(self, self.wanted.size)
        if self.wanted.lights:
            lights.put_lights(self)
        robot.warnings += self.shared.looks.warnings
        return robot

    def _keypoints(self) -> Sequence[str]:
        """Names of the joints that are keypoints: those requested, or the first joint of each
        body."""
        if self.wanted.keypoints is not None:
            return self.wanted.keypoints
        model = self.source.model
        names = self.source.names("joint", model.njnt)
        return [names[j] for j in model.body_jntadr if j >= 0]

    # ------------------------------------------------------------ what Builder asks for

    def _put_root(self, components: patches.Components) -> None:
        given: dict[str, Any] = dict(components)
        self.of_instances = {n: given.pop(n) for n in _OF_INSTANCES if n in given}
        self.robot.root = self.edits.entity(self.robot.name, exist_ok=False, **given)

    def _link_components(self, link: str) -> patches.Components:
        """Components of an instance, for the uppermost link of one; {} for other links."""
        if link not in self._tops().values():
            return {}
        given: dict[str, Any] = {"label": "auto", **self.of_instances}
        below = {joint.name: joint.child for joint in self.model.joints}
        pairs = [pair for pair in self.robot.skeleton if self._top_of(below[pair[1]]) == link]
        if pairs:
            own = {"skeleton": json.dumps(pairs)}
            given["attributes"] = {**own, **(given.get("attributes") or {})}
        return cast("patches.Components", given)

    def _tops(self) -> dict[str, str]:
        """The uppermost link of each body beneath the world."""
        parents = self.source.model.body_parentid
        bodies = [body for b, body in enumerate(self.bodies) if b and parents[b] == 0]
        return {body: self._top_of(body) for body in bodies}

    def _top_of(self, link: str) -> str:
        """The link above or itself that is beneath the world."""
        while self.above[link] != WORLD:
            link = self.above[link]
        return link

    def _put_visual(self, visual: Surface, name: str, link: tuple[Entity, int]) -> None:
        parent, part = link
        name = self.free_name(f"{parent.name}/{visual.name}")
        entity = self.edits.entity(
            name,
            exist_ok=False,
            parent=parent,
            transform=visual.pose,
            part=part,
            mesh=self.mesh(visual.shape, name),
            material=self.shared.looks.material(self.edits, visual.look),
        )
        seen = self.robot.sites if visual.kind == "site" else self.robot.geoms
        seen[visual.name] = entity

    # ------------------------------------------------------------ what the others ask for

    def free_name(self, name: str) -> str:
        """Takes a name, or that name with a number if it is taken."""
        found, number = name, 2
        while found in self.names:
            found, number = f"{name}_{number}", number + 1
        self.names.add(found)
        return found

    def mesh(self, shape: Shape, name: str) -> Mesh:
        if shape not in self.shared.meshes:
            arrays = geometry(self.source, shape)
            self.shared.meshes[shape] = self.edits.mesh(f"{name}/mesh", exist_ok=False, **arrays)
        return self.shared.meshes[shape]

    def link(self, body: int) -> tuple[Entity, int]:
        """The entity of a body and the number of its part."""
        name = self.bodies[body]
        return self.robot.links[name], self.robot.parts[name]
