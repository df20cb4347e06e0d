"""Robots of URDF files: their links as entities, moved by the values of their joints.

Made by edit.import_urdf(); docs/robots.md.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union, cast

import numpy as np

from .._wire.arrays import NdArray
from .._wire.tensors import is_tensor, on_host
from ..errors import InvalidArgument
from ..scene import patches
from ..scene.handles import Entity, Group
from ..values.checks import refuse_given
from . import urdf
from ._library import Library
from .building import Options, UrdfBuilder
from .description import RobotModel
from .kinematics import Kinematics

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..client.edit import Edits
    from ..client.scene import Scene

_AS_READ = {"packages": {}, "strict": False}
_STEP = math.pi / 3  # the most that a joint turns from key to key


class Robot:
    """A robot in a scene.

    root: the entity that carries its pose and its label, in the place of the first link's frame.
    links: entities by link name, parents first; poses are relative to the link above.
    parts: {link name: its number in the plane "part"}; link_of() turns these round.
    keypoints: the joints that labels report, and skeleton: pairs of them that are neighbours.
    moving: the M links below joints that are not fixed, as a Group.
    warnings: gaps in the file, elements left out, and links that alpha hides from labels.
    """

    def __init__(
        self, scene: Scene, name: str, model: RobotModel, library: Library | None = None
    ) -> None:
        self.scene = scene
        self.name = name
        self.model = model
        self.library = library or Library(model.roots)
        self.kinematics = Kinematics(model)
        self.warnings = list(model.warnings)
        self.links: dict[str, Entity] = {}
        self.parts = {link: number for number, link in enumerate(model.links, 1)}
        self.keypoints: list[str] = []
        self.skeleton: list[tuple[str, str]] = []
        self.root: Entity
        self.moving: Group

    @property
    def link_names(self) -> list[str]:
        """Names of the L links, parents first."""
        return list(self.kinematics.link_names)

    @property
    def joint_names(self) -> list[str]:
        """Names of the C columns of an array of values; see kinematics.Kinematics."""
        return list(self.kinematics.joint_names)

    @property
    def limits(self) -> NdArray:
        """(C, 2) float64: radians or metres; -inf and inf without limits."""
        return self.kinematics.limits.copy()

    @property
    def rest(self) -> NdArray:
        """(C,) float64: the values it is imported with: 0, or the limit next to it; of an MJCF file
        qpos0."""
        return self.kinematics.rest.copy()

    def link_of(self, part: Any) -> NdArray:
        """int64 of the same shape: of numbers of the plane "part" the place of the link in
        link_names; -1 for 0, no part, and for numbers that no link has."""
        number = np.asarray(part, np.int64)
        return np.where(number <= len(self.parts), number - 1, -1)

    def forward(self, values: Any, *, clamp: bool = False) -> Any:
        """(L, 4, 4) float64 root_from_link; (N, L, 4, 4) for N sets of values, as set_joints()
        takes them; of a tensor a tensor."""
        return self.kinematics.forward(self.kinematics.values(values, clamp))

    def transforms(self, values: Any, *, clamp: bool = False) -> Any:
        """(M, 4, 4) float64 poses of `moving`, relative to the links above; (N, M, 4, 4) for N sets
        of values; of a tensor a tensor. For set_transforms() of edits and worlds."""
        return self.kinematics.local(self.kinematics.values(values, clamp))

    def __repr__(self) -> str:
        links, joints = len(self.links), len(self.joint_names)
        return f"<Robot {self.name!r}, {links} links, {joints} joints>"


Robots = Union[Robot, Sequence[Robot]]


def listed(robots: Robots) -> list[Robot]:
    """Robots with the same joints."""
    found = [robots] if isinstance(robots, Robot) else list(robots)
    for robot in found:
        if not isinstance(robot, Robot):
            raise InvalidArgument(
                f"robot: needs an hg.Robot or a sequence of them, not {robot!r}", field="robot"
            )
        if robot.joint_names != found[0].joint_names:
            raise InvalidArgument(
                f"robot: {robot!r} and {found[0]!r} have different joints; one call for each",
                field="robot",
            )
    return found


class RobotEdits:
    """The part of Edits that makes and moves robots."""

    def import_urdf(
        self,
        path: str | os.PathLike[str] | Robot,
        *,
        name: str | None = None,
        packages: Mapping[str, str | os.PathLike[str]] | None = None,
        keypoints: Sequence[str] | None = None,
        mesh_materials: bool = False,
        strict: bool = False,
        **components: Unpack[patches.Components],
    ) -> Robot:
        """Reads a robot from a URDF file and places it: entities `name`, and "<name>/<link>". path:
        another Robot is placed again, with the same meshes and materials.

        packages: folders by package name, for package:// references; the package that the file is
        in need not be named. keypoints: names of the joints that labels report, by default all.
        mesh_materials: True keeps the materials of meshes that have some; by default the URDF's
        come first. strict: refuses odd or missing parts of the file; by default they are left out
        or repaired, with `warnings` of the robot.
        components: of the root, as edit.entity() takes them: transform, parent, category, ...
        InvalidArgument or NotFound for xacro, and for a robot none of whose visuals can be read:
        files outside the URDF's folder and packages are not.
        """
        options = Options(packages or {}, mesh_materials, strict)
        edits = cast("Edits", self)
        if isinstance(path, Robot):
            if type(path) is not Robot:
                raise InvalidArgument(
                    f"path: {path!r} is of no URDF file; place it as it was read, with import_mjcf "
                    "or, its whole asset, import_usd",
                    field="path",
                )
            why = "a robot is placed again as it was read; give it with the file"
            refuse_given({"packages": options.packages, "strict": strict}, _AS_READ, why)
            robot = Robot(edits.scene, name or path.name, path.model, path.library)
        else:
            model = urdf.read(path, options.packages, options.strict)
            robot = Robot(edits.scene, name or model.name, model)
        return UrdfBuilder(edits, robot, options).build(keypoints, components)

    def set_joints(
        self,
        robot: Robots,
        values: Any = None,
        *,
        keys: Mapping[float, Any] | None = None,
        clamp: bool = False,
        teleport: bool = False,
    ) -> None:
        """Moves the joints of one robot, or of N robots with the same joints in one packed message.

        values: (C,) in the order of robot.joint_names, (N, C) for N robots; or {name: number}, or
        (N,) for N robots, where joints without a name stay. Radians and metres. A floating joint
        takes a hg.Pose, (4, 4), or position and quaternion w x y z, (7,); a spherical one (a ball
        of MJCF) a rotation (3, 3), a hg.Pose that only turns, or a quaternion (4,); a planar one
        (x, y, angle).
        A tensor of PyTorch: poses are worked out where it is, and stay there on a GPU.
        keys: {seconds: values} instead, for motion blur; joints move evenly between them.
        clamp: values beyond the limits are put on them; otherwise InvalidArgument names the joint,
        its value and its limits. teleport: as of set_transforms().
        """
        edits = cast("Edits", self)
        robots = listed(robot)
        if not robots:
            return
        if (values is None) == (keys is None):
            raise InvalidArgument("give values or keys", field="values")
        if keys is not None:
            rows = {t: _rows(robots, on_host(keys[t]), clamp) for t in keys}
            _set_keys(edits, robots, rows)
            return
        kinematics = robots[0].kinematics
        local = kinematics.local(_rows(robots, values, clamp))
        moved = list(range(len(kinematics.moving)))
        if isinstance(values, Mapping):
            moved = kinematics.moved_by(list(values))
        if len(robots) == 1 and len(moved) == len(robots[0].moving):
            edits.set_transforms(robots[0].moving, local[0], teleport=teleport)
            return
        entities = [r.moving[i] for r in robots for i in moved]
        matrices = local[:, moved].reshape(-1, 4, 4)
        edits.set_transforms(entities, matrices, teleport=teleport)


def _rows(robots: Sequence[Robot], values: Any, clamp: bool) -> Any:
    """(N, C) values of N robots."""
    rows = robots[0].kinematics.values(values, clamp)
    shape = (len(robots), rows.shape[-1])
    if rows.ndim == 2 and len(rows) != len(robots):
        raise InvalidArgument(
            f"values: {len(rows)} rows for {len(robots)} robots; give as many", field="values"
        )
    return rows.expand(shape) if is_tensor(rows) else np.broadcast_to(rows, shape)


def _set_keys(edits: Edits, robots: Sequence[Robot], keys: Mapping[float, NdArray]) -> None:
    """Keys of the moving links, with further ones in between where a joint turns far."""
    kinematics = robots[0].kinematics
    times = sorted(keys)
    rows = {t: keys[t] for t in times}
    for begin, end in zip(times[:-1], times[1:]):
        parts = math.ceil(kinematics.turned(keys[begin], keys[end]) / _STEP - 1e-9)
        for i in range(1, parts):
            share = i / parts
            time = begin + share * (end - begin)
            rows[time] = kinematics.between(keys[begin], keys[end], share)
    local = {t: kinematics.local(rows[t]) for t in sorted(rows)}
    for n, robot in enumerate(robots):
        for i, entity in enumerate(robot.moving):
            edits.update(entity, keys={t: local[t][n, i] for t in local})
