"""Joints of a stage that follow others. Needs pxr.

Source: the schemas NewtonMimicAPI (joint = coef0 + coef1 * leader) and PhysxMimicJointAPI
(joint + gearing * leader + offset = 0), in the units of the stage: degrees, or its length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..robots.description import ONE_AXIS, Joint, Mimic
from .context import Context
from .joints import Found

_PHYSX = "physxMimicJoint:"
_APART = 1e-3  # radians, metres
Names = Mapping[str, Mapping[str, str]]  # of freedoms, by the path of their joint and by token


def put(
    context: Context, found: Sequence[Found], names: Names, joints: Sequence[Joint]
) -> list[Joint]:
    """Joints of a robot, with followers of others as mimics."""
    by_name = {joint.name: joint for joint in joints}
    scales = {
        names[one.path][freedom.token]: freedom.scale for one in found for freedom in one.freedoms
    }
    for one in found:
        for token, path, axis, (first, factor) in _authored(context, one.prim):
            follower, leader = _name(names, one.path, token), _name(names, path, axis)
            why = _fault(by_name, follower, leader)
            if why:
                context.note(one.path, f"the joint that it follows is ignored: {why}")
                continue
            scale = scales[follower]
            mimic = Mimic(leader, factor * scale / scales[leader], first * scale)
            by_name[follower] = replace(by_name[follower], mimic=mimic)
            _note_where(context, one, by_name)
    return [by_name[joint.name] for joint in joints]


def _authored(context: Context, prim: Any) -> Iterator[tuple[str, str, str, tuple[float, float]]]:
    """The freedom that follows, the joint and the freedom that lead, and the two coefficients."""

    def number(name: str, default: float) -> float:
        return context.number(prim.GetAttribute(name), default)

    leaders = prim.GetRelationship("newton:mimicJoint").GetForwardedTargets()
    if leaders and context.value(prim.GetAttribute("newton:mimicEnabled")) is not False:
        own = number("newton:mimicCoef0", 0.0), number("newton:mimicCoef1", 1.0)
        yield "", str(leaders[0]), "", own
        return
    for relation in prim.GetRelationships():
        name = relation.GetName()
        leaders = relation.GetForwardedTargets()
        if name.startswith(_PHYSX) and name.endswith(":referenceJoint") and leaders:
            own_axis = name.split(":")[1]
            above = f"{_PHYSX}{own_axis}"
            axis = context.value(prim.GetAttribute(f"{above}:referenceJointAxis")) or ""
            gearing = number(f"{above}:gearing", 0.0)
            offset = number(f"{above}:offset", 0.0)
            yield own_axis, str(leaders[0]), str(axis), (-offset, -gearing)


def _name(names: Names, path: str, token: str) -> str:
    """Name of a freedom; a joint with one freedom has its name, whatever its axis is called."""
    own = names.get(path, {})
    return next(iter(own.values())) if len(own) == 1 else own.get(token, "")


def _fault(joints: Mapping[str, Joint], follower: str, leader: str) -> str:
    if leader not in joints or joints[leader].kind not in ONE_AXIS:
        return "its leader is no joint of one axis of the same robot"
    if follower not in joints or joints[follower].kind not in ONE_AXIS:
        return "it has no such axis"
    at: Joint | None = joints[leader]
    while at is not None:
        if at.name == follower:
            return "it would follow itself"
        at = joints[at.mimic.joint] if at.mimic else None
    return ""


def _note_where(context: Context, one: Found, joints: Mapping[str, Joint]) -> None:
    """Notes that the stage has a follower elsewhere than the joint that it follows puts it."""
    for joint in joints.values():
        if joint.mimic and joint.name == one.path.rpartition("/")[2]:
            leader = joints[joint.mimic.joint]
            wanted = joint.mimic.multiplier * (leader.rest or (0.0,))[0] + joint.mimic.offset
            if abs(wanted - (joint.rest or (0.0,))[0]) > _APART:
                context.note(
                    one.path, "it is not where the joint that it follows has it: put there"
                )
