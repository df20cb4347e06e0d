"""The joints between two bodies, to joints of a robot. Used by articulations.py."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._wire.arrays import NdArray
from ..robots.description import ONE_AXIS, Joint
from . import rest
from .context import Context
from .joints import WORLD, Found, Freedom, Joints

_NEAR = 1e-6  # metres: as far as axes may pass the origin of a link
_APART = 1e-3  # metres, radians: as far as bodies may be from where their joint has them


@dataclass(frozen=True)
class Edge:
    """Joints that move `child` in `parent`: from one to the other, or back."""

    parent: str
    child: str
    joints: list[Found]


@dataclass(frozen=True, eq=False)
class _Step:
    """A freedom with its name, the transform before it, and its value at rest."""

    name: str
    freedom: Freedom
    before: NdArray
    value: rest.Value


class Chains:
    """Names and joints of one robot. links: names by the path of the body; names: of the freedoms
    of a joint, by its path; targets: of drives, radians or metres, by the joint's name."""

    def __init__(
        self, context: Context, joints: Joints, bodies: Sequence[str], found: Sequence[Found]
    ) -> None:
        self.context = context
        self.rest = joints.rest
        self.links = _short(bodies)
        self.targets: dict[str, float] = {}
        self._joints = _short([joint.path for joint in found])
        self.names = {one.path: _names(self._joints[one.path], one.freedoms) for one in found}

    def in_file_order(self, joints: Sequence[Joint]) -> list[Joint]:
        names = [name for own in self.names.values() for name in own.values()]
        order = {name: place for place, name in enumerate(names)}
        return sorted(joints, key=lambda joint: order.get(joint.name, len(order)))

    def of(self, edge: Edge) -> list[Joint]:
        """Parents first. A body with several freedoms, or one that is not about its origin, has
        links without anything to be seen in between."""
        steps, after = self._steps(edge)
        parent, child = self.links[edge.parent], self.links[edge.child]
        if not steps:
            name = self._joints[edge.joints[0].path]
            return [Joint(name, "fixed", parent, child, after, np.array([1.0, 0, 0]))]
        made = []
        for one in steps:
            made.append(_joint(one, parent, f"{child}:{one.name}"))
            parent = made[-1].child
        last = _closed(made[-1], after)
        if last is not None:
            return [*made[:-1], replace(last, child=child)]
        fixed = Joint(f"{child}:fixed", "fixed", parent, child, after, np.array([1.0, 0, 0]))
        return [*made, fixed]

    def _steps(self, edge: Edge) -> tuple[list[_Step], NdArray]:
        """Freedoms from parent to child, and the transform behind the last."""
        is_turned = edge.joints[0].bodies[0] != edge.parent
        parts = []
        for number, joint in enumerate(edge.joints):
            before = joint.frames[1] if number else joint.frames[0]
            values = self._values(joint, is_alone=len(edge.joints) == 1)
            parts.append((before, joint, values, np.linalg.inv(joint.frames[1])))
        if is_turned:
            parts = [
                (np.linalg.inv(after), _turned(joint), _back(joint, values), np.linalg.inv(before))
                for before, joint, values, after in reversed(parts)
            ]
        steps, at = [], np.eye(4)
        for before, joint, values, after in parts:
            at = at @ before
            for freedom, value in zip(joint.freedoms, values):
                name = self.names[joint.path][freedom.token]
                steps.append(_Step(name, freedom, at, value))
                at = np.eye(4)
            at = at @ after
        return steps, at

    # ------------------------------------------------------------ where the stage stands

    def _values(self, joint: Found, is_alone: bool) -> list[rest.Value]:
        """Values at rest: by the joint's state, or else by the poses of its bodies."""
        first, second = (self.rest[b] @ f for b, f in zip(joint.bodies, joint.frames))
        pose = np.linalg.inv(first) @ second
        found = rest.values_of(joint.freedoms, pose)
        if not is_alone:  # where several share two bodies, each of them stands at 0
            found = [(0.0,) for _ in found]
        self._read_targets(joint)
        stated = [self._stated(joint, one, value) for one, value in zip(joint.freedoms, found)]
        apart = max((abs(a - b) for s, f in zip(stated, found) for a, b in zip(s, f)), default=0)
        if apart > _APART:
            self.context.note(joint.path, "its state says other than its bodies' places: it counts")
        elif np.abs(rest.moved(joint.freedoms, found) - pose).max() > _APART:
            self.context.note(
                joint.path, "its bodies are not where it has them: they are put there"
            )
        return stated

    def _stated(self, joint: Found, freedom: Freedom, value: rest.Value) -> rest.Value:
        for name in (f"state:{freedom.token}:physics:position", f"newton:{freedom.token}:position"):
            found = self.context.value(joint.prim.GetAttribute(name))
            if found is not None and np.isfinite(found):
                return (float(found) * freedom.scale,)
        return value

    def _read_targets(self, joint: Found) -> None:
        """A drive without stiffness draws nowhere."""
        for freedom in joint.freedoms:
            drive = f"drive:{freedom.token}:physics"
            target, stiffness = (
                self.context.value(joint.prim.GetAttribute(f"{drive}:{name}"))
                for name in ("targetPosition", "stiffness")
            )
            if target is not None and np.isfinite(target) and stiffness:
                self.targets[self.names[joint.path][freedom.token]] = target * freedom.scale


def _names(name: str, freedoms: Sequence[Freedom]) -> dict[str, str]:
    """Names of a joint's freedoms by token: a single one has the joint's own name."""
    if len(freedoms) == 1:
        return {freedoms[0].token: name}
    return {one.token: f"{name}:{one.token}" for one in freedoms}


def _short(paths: Sequence[str]) -> dict[str, str]:
    """Names of prims; prims that share one get their whole path. WORLD has a name, too."""
    count = Counter(path.rpartition("/")[2] for path in dict.fromkeys(paths))
    out = {}
    for path in paths:
        last = path.rpartition("/")[2]
        out[path] = last if count[last] == 1 else path.lstrip("/")
    if WORLD in out:
        name = "world"
        while name in out.values():
            name += "'"
        out[WORLD] = name
    return out


def _turned(joint: Found) -> Found:
    """Joint from its second body to its first: values keep their sense."""
    freedoms = tuple(replace(one, axis=-one.axis) for one in reversed(joint.freedoms))
    return replace(joint, freedoms=freedoms)


def _back(joint: Found, values: Sequence[rest.Value]) -> list[rest.Value]:
    """Values of the _turned() joint; quaternions are of the lower link in the upper one."""
    out = []
    for one, value in zip(joint.freedoms, values):
        is_whole = one.kind == "spherical"
        out.append((value[0], *(-v for v in value[1:])) if is_whole else value)
    return out[::-1]


def _joint(one: _Step, parent: str, child: str) -> Joint:
    freedom = one.freedom
    is_alone = freedom.kind in ONE_AXIS
    origin = one.before @ rest.step(freedom, one.value) if is_alone else one.before
    return Joint(
        *(one.name, freedom.kind, parent, child, origin, freedom.axis),
        lower=freedom.lower,
        upper=freedom.upper,
        rest=one.value,
    )


def _closed(joint: Joint, after: NdArray) -> Joint | None:
    """A joint with a pose behind it as one that ends there; None: its axis is elsewhere."""
    past = after[:3, 3] - (after[:3, 3] @ joint.axis) * joint.axis
    if joint.kind not in ONE_AXIS:
        return joint if np.abs(after - np.eye(4)).max() < _NEAR else None
    if joint.kind != "prismatic" and np.linalg.norm(past) > _NEAR:
        return None
    return replace(joint, origin=joint.origin @ after, axis=after[:3, :3].T @ joint.axis)
