"""Joints that follow others. Used by urdf.py."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ._motion import Motion
from ._notes import Notes
from .description import ONE_AXIS, Joint


def settled(joints: Mapping[str, Joint], notes: Notes) -> list[Joint]:
    """Joints of a robot, where each that follows one that never moves is fixed at its value."""
    return [_settled(joint, joints, notes) for joint in joints.values()]


def _settled(joint: Joint, joints: Mapping[str, Joint], notes: Notes) -> Joint:
    if joint.mimic is None:
        return joint
    if joint.kind == "fixed":
        notes.warn(f"joint {joint.name!r} is fixed; its <mimic> is left out")
        return replace(joint, mimic=None)
    value = _standing(joint, joints, notes)
    if value is None:
        return joint
    why = "is fixed" if joint.mimic.joint in joints else "is no joint"
    notes.warn(
        f"joint {joint.name!r} mimics {joint.mimic.joint!r}, which {why}; it is fixed at {value:g}"
    )
    return _fixed(joint, value)


def _standing(joint: Joint, joints: Mapping[str, Joint], notes: Notes) -> float | None:
    """The value of a joint that follows a fixed one, or one that is absent; None: it moves."""
    factor, offset, at = 1.0, 0.0, joint
    seen = [joint.name]
    while at.mimic is not None and at.kind != "fixed":
        if at.mimic.joint not in joints:
            return factor * float(np.clip(0.0, at.lower, at.upper)) + offset
        offset += factor * at.mimic.offset
        factor *= at.mimic.multiplier
        where = f"joint {at.name!r}"
        at = joints[at.mimic.joint]
        if at.name in seen:
            raise notes.refusal(f"mimics itself, by way of {', '.join(seen)}", where)
        seen.append(at.name)
        if at.kind not in (*ONE_AXIS, "fixed") or joint.kind not in ONE_AXIS:
            raise notes.refusal(f"mimics {at.name!r}: both need one axis", where)
    return offset if at.kind == "fixed" else None


def _fixed(joint: Joint, value: float) -> Joint:
    """A joint of one axis that stays at a value."""
    alone = replace(joint, mimic=None)
    origin = Motion([alone], {joint.name: 0}, np.zeros((1, 2))).local(np.array([value]))[0]
    return replace(alone, kind="fixed", origin=origin)
