"""Bodies that joints connect, to articulations of the model. Needs pxr.

Source: "Rigid Body Physics in Universal Scene Description" (openusd.org, UsdPhysics).
"""

from __future__ import annotations

import os.path
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from pxr import UsdPhysics

from .._wire.arrays import NdArray
from ..robots.description import RobotModel
from . import mimics
from .chains import Chains, Edge
from .context import Context
from .joints import WORLD, Found, Joints, goes_on
from .model import Articulation, Model, Node


def put(context: Context) -> None:
    """Articulations of the model, and the parts of its nodes that their links are."""
    joints = Joints(context)
    groups = _groups(context, joints)
    nodes = {node.path: node for node in context.model.nodes}
    for path, group in zip(_keys(context, groups), groups):
        found = _Maker(context, joints, group, nodes).made(path)
        if found is not None:
            context.model.articulations.append(found)
    _number_parts(context.model)


def _number_parts(model: Model) -> None:
    """Numbers the parts of all visible prims beneath the bodies: parents are before children."""
    numbers: dict[str | None, int] = {}
    for found in model.articulations:
        of_links = {link: number for number, link in enumerate(found.robot.links, 1)}
        numbers.update({path: of_links[link] for path, (link, _) in found.bodies.items()})
    for node in model.nodes:
        number = numbers.get(node.path) or numbers.get(node.parent)
        if number is not None:
            numbers[node.path] = number
            if node.mesh is not None:
                node.rest["part"] = number


# ------------------------------------------------------------ what goes together


@dataclass(eq=False)
class _Group:
    """Bodies that joints connect, in the order of these. pairs: joints by the bodies that they
    are between. anchor: the pair of which one is the world."""

    bodies: list[str] = field(default_factory=list)
    pairs: dict[tuple[str, str], list[Found]] = field(default_factory=dict)
    anchor: tuple[str, str] | None = None

    def joints(self) -> Iterator[Found]:
        for pair in self.pairs.values():
            yield from pair


def _groups(context: Context, joints: Joints) -> list[_Group]:
    """Groups of bodies that joints connect and move. The last joint that would close a loop is left
    out."""
    of: dict[str, _Group] = {}
    for joint in joints.found():
        groups = [of.setdefault(b, _Group([b])) for b in joint.bodies if b != WORLD]
        pair = groups[0].pairs.get(joint.bodies)
        if pair is not None and goes_on(pair, joint):
            pair.append(joint)
        elif _closes_a_loop(groups):
            context.note(joint.path, "a joint that closes a loop is left out")
        else:
            _join(of, groups)
            groups[0].pairs[joint.bodies] = [joint]
            if len(groups) == 1:
                groups[0].anchor = joint.bodies
    found = {id(group): group for group in of.values()}.values()
    return [group for group in found if any(joint.freedoms for joint in group.joints())]


def _closes_a_loop(groups: list[_Group]) -> bool:
    if len(groups) == 1:
        return groups[0].anchor is not None
    return groups[0] is groups[1] or None not in (groups[0].anchor, groups[1].anchor)


def _join(of: dict[str, _Group], groups: list[_Group]) -> None:
    first = groups[0]
    for other in groups[1:]:
        first.bodies += other.bodies
        first.pairs.update(other.pairs)
        first.anchor = first.anchor or other.anchor
        of.update(dict.fromkeys(other.bodies, first))


def _keys(context: Context, groups: list[_Group]) -> list[str]:
    """A path for each: of its PhysicsArticulationRootAPI, of what all its bodies are beneath, of
    the stage's default prim; the first of these that is no body and of no other. Or of its base."""
    wanted = [list(_candidates(context, group)) for group in groups]
    count = Counter(path for paths in wanted for path in set(paths))
    return [next((p for p in paths if count[p] == 1), paths[-1]) for paths in wanted]


def _candidates(context: Context, group: _Group) -> Iterator[str]:
    base = _base(context, group)
    for path in (_schema_root(context, base), os.path.commonpath(group.bodies)):
        if path != "/" and path not in group.bodies:
            yield path
    default = context.stage.GetDefaultPrim()
    if default and base.startswith(f"{default.GetPath()}/"):
        yield str(default.GetPath())
    yield base


def _schema_root(context: Context, path: str) -> str:
    """The nearest prim from a path upwards with PhysicsArticulationRootAPI; "/": none."""
    prim = context.stage.GetPrimAtPath(path)
    while not (prim.IsPseudoRoot() or prim.HasAPI(UsdPhysics.ArticulationRootAPI)):
        prim = prim.GetParent()
    return str(prim.GetPath())


def _base(context: Context, group: _Group) -> str:
    """Base of a group: fixed to the world, or the root by its schema, or without a joint above
    it."""
    if group.anchor is not None:
        return next(body for body in group.anchor if body != WORLD)
    for body in group.bodies:
        if context.stage.GetPrimAtPath(body).HasAPI(UsdPhysics.ArticulationRootAPI):
            return body
    below = {second for _, second in group.pairs}
    return next((body for body in group.bodies if body not in below), group.bodies[0])


# ------------------------------------------------------------ one articulation


class _Maker:
    """Makes the articulation of a group."""

    def __init__(
        self, context: Context, joints: Joints, group: _Group, nodes: Mapping[str, Node]
    ) -> None:
        self.context = context
        self.joints = joints
        self.group = group
        self.nodes = nodes

    def made(self, path: str) -> Articulation | None:
        """None: it cannot be moved by its joints (noted)."""
        group, base = self.group, _base(self.context, self.group)
        above = self._above()
        why = self._stands_still(above)
        if why:
            self.context.note(path, f"its joints are left out: {why}")
            return None
        self._keep_hidden(above)
        anchor = group.pairs[group.anchor] if group.anchor else []
        root = WORLD if any(joint.freedoms for joint in anchor) else base
        chains = Chains(self.context, self.joints, [root, *group.bodies], list(group.joints()))
        made = [joint for edge in self._edges(root) for joint in chains.of(edge)]
        followed = mimics.put(self.context, list(group.joints()), chains.names, made)
        links = [chains.links[root], *(joint.child for joint in made)]
        robot = RobotModel(
            path.rpartition("/")[2],
            links,
            {link: [] for link in links},
            chains.in_file_order(followed),
            soft_limits=True,
        )
        pose = np.linalg.inv(self._world(above)) @ self.joints.rest[root]
        bodies = {body: (chains.links[body], self._in_link(body)) for body in group.bodies}
        return Articulation(path, above, pose, robot, bodies, chains.targets, self._category(above))

    def _edges(self, root: str) -> Iterator[Edge]:
        """Yields the edges from the root on, parents first, depth first."""
        left = {pair: joints for pair, joints in self.group.pairs.items()}
        waiting = [root]
        if root != WORLD and self.group.anchor:
            del left[self.group.anchor]
        while waiting:
            at = waiting[-1]
            pair = next((pair for pair in left if at in pair), None)
            if pair is None:
                waiting.pop()
                continue
            child = pair[1] if pair[0] == at else pair[0]
            yield Edge(at, child, left.pop(pair))
            waiting.append(child)

    def _in_link(self, body: str) -> NdArray:
        """(4, 4) link_from_prim: the scale of the body."""
        prim = self.context.stage.GetPrimAtPath(body)
        world = self.joints.world(prim)
        return self.context.thick(prim, np.linalg.inv(self.joints.rest[body]) @ world)

    # ------------------------------------------------------------ where it hangs

    def _above(self) -> str | None:
        """The node that has all bodies beneath it and is in none of them."""
        path = os.path.commonpath(self.group.bodies)
        inside = [body for body in self.group.bodies if f"{path}/".startswith(f"{body}/")]
        path = min(inside, key=len).rpartition("/")[0] if inside else path
        while path.strip("/") and path not in self.nodes:
            path = path.rpartition("/")[0]
        if not path.strip("/") or np.linalg.matrix_rank(self._world(path)) < 4:
            return None
        return path

    def _category(self, above: str | None) -> str:
        """Category of the nearest node upwards that has one; "" without."""
        while above is not None and "category" not in self.nodes[above].rest:
            above = self.nodes[above].parent
        return "" if above is None else str(self.nodes[above].rest["category"])

    def _world(self, path: str | None) -> NdArray:
        """(4, 4) root_from_node."""
        if path is None:
            return np.eye(4)
        return self.joints.world(self.context.stage.GetPrimAtPath(path))

    def _stands_still(self, above: str | None) -> str:
        """Reason why joints do not move the bodies; "": they do."""
        for body in self.group.bodies:
            if body not in self.nodes:
                return f"{body} is a prototype of instances, or nothing that has a place"
            for at in self._between(body, above):
                if isinstance(self.nodes[at].pose, Mapping):
                    return f"{at} moves by itself; without times= it does not"
        return ""

    def _between(self, body: str, above: str | None) -> Iterator[str]:
        """A body's node and its ancestors, up to the one above all bodies."""
        at: str | None = body
        while at is not None and at != above:
            yield at
            at = self.nodes[at].parent

    def _keep_hidden(self, above: str | None) -> None:
        """Hides bodies beneath a hidden prim, although their entities will be beneath a link."""
        for body in self.group.bodies:
            if any(self.nodes[a].rest.get("visible") is False for a in self._between(body, above)):
                self.nodes[body].rest["visible"] = False
