"""Joints of UsdPhysics, each as the stage has it. Needs pxr.

Source: "Rigid Body Physics in Universal Scene Description" (openusd.org, UsdPhysics), for frames,
axes and limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from .._wire.arrays import NdArray
from ..values.pose import rotation_of_wxyz
from .context import Context, matrix_of

PRIMS = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
WORLD = ""  #: path of the world, which bodies are fixed to
_SAME = 1e-5  # metres, radians
_ENDLESS = 1e30  # limits above are none: exporters write the largest float
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_SLIDES, _TURNS = (tuple(f"{kind}{axis}" for axis in _AXES) for kind in ("trans", "rot"))


@dataclass(frozen=True, eq=False)
class Freedom:
    """Freedom of a joint. token: names its limit, drive and state; "rot": all turns. axis: (3,) in
    the joint's frame. scale: radians or metres per unit."""

    token: str
    kind: str
    axis: NdArray
    scale: float
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True, eq=False)
class Found:
    """A joint. bodies: paths of the two, or WORLD. frames: (4, 4) each, body_from_joint, rigid and
    in metres; where the body is the world, root_from_joint. freedoms: none of a fixed one."""

    prim: Any
    bodies: tuple[str, str]
    frames: tuple[NdArray, NdArray]
    freedoms: tuple[Freedom, ...]

    @property
    def path(self) -> str:
        return str(self.prim.GetPath())


class Joints:
    """Joints of one stage. rest: (4, 4) root_from_body by path, rigid and in metres."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.rest: dict[str, NdArray] = {WORLD: np.eye(4)}
        self._cache = UsdGeom.XformCache(context.time)

    def found(self) -> list[Found]:
        """Lists the joints in the stage's order; those that connect nothing are noted."""
        return [joint for prim in self.context.stage.Traverse(PRIMS) for joint in self._read(prim)]

    def world(self, prim: Any) -> NdArray:
        """(4, 4) root_from_local, with its scale; a transform that is not finite counts as the
        identity."""
        local = matrix_of(self._cache.GetLocalToWorldTransform(prim))
        return self.context.up @ (local if np.isfinite(local).all() else np.eye(4))

    def _read(self, prim: Any) -> Iterator[Found]:
        if not prim.IsA(UsdPhysics.Joint):
            if str(prim.GetTypeName()).endswith("Joint"):
                self.context.note(prim, f"{prim.GetTypeName()} is left out")
            return
        why = self._left_out(prim)
        ends = [self._end(prim, side) for side in (0, 1)]
        if not why and None in ends:
            why = "a joint whose body is not there, or whose frame is not finite, is left out"
        bodies = tuple(end[0] for end in ends if end is not None)
        if not why and bodies[0] == bodies[1]:
            why = "a joint that connects no two bodies is left out"
        if why:
            self.context.note(prim, why)
            return
        frames = tuple(end[1] for end in ends if end is not None)
        yield Found(prim, (bodies[0], bodies[1]), (frames[0], frames[1]), self._freedoms(prim))

    def _left_out(self, prim: Any) -> str:
        joint = UsdPhysics.Joint(prim)
        if prim.IsA(UsdPhysics.DistanceJoint):
            return f"{prim.GetTypeName()} is left out"
        if self.context.value(joint.GetJointEnabledAttr()) is False:
            return "a joint that is not enabled is left out"
        if self.context.value(joint.GetExcludeFromArticulationAttr()):
            return "a joint that is excluded from its articulation is left out"
        return ""

    # ------------------------------------------------------------ frames

    def _end(self, prim: Any, side: int) -> tuple[str, NdArray] | None:
        """The body on one side, and body_from_joint; None: there is no such."""
        at = prim.GetStage().GetPseudoRoot()
        targets = prim.GetRelationship(f"physics:body{side}").GetForwardedTargets()
        if targets:
            at = prim.GetStage().GetPrimAtPath(targets[0].GetPrimPath())
        if not at or len(targets) > 1:
            return None
        frame = self._frame(prim, side, self.world(at))
        if not np.isfinite(frame).all():
            return None
        body = _body(at)
        path = str(body.GetPath()) if body else WORLD
        if path not in self.rest:
            self.rest[path] = rigid(self.world(body))
        return path, np.linalg.inv(self.rest[path]) @ frame

    def _frame(self, prim: Any, side: int, world: NdArray) -> NdArray:
        """(4, 4) root_from_joint: its place is in the scaled frame of its body."""
        value = self.context.value
        place = value(prim.GetAttribute(f"physics:localPos{side}")) or (0.0, 0.0, 0.0)
        turn = value(prim.GetAttribute(f"physics:localRot{side}"))
        out = rigid(world)
        out[:3, 3] = (world @ [*place, 1.0])[:3]
        if turn is not None and turn.GetLength() > 0:
            wxyz = np.array([turn.GetReal(), *turn.GetImaginary()], "f8")
            out[:3, :3] = out[:3, :3] @ rotation_of_wxyz(wxyz / np.linalg.norm(wxyz))
        return out

    # ------------------------------------------------------------ freedoms

    def _freedoms(self, prim: Any) -> tuple[Freedom, ...]:
        axis = np.array(
            _AXES.get(str(self.context.value(prim.GetAttribute("physics:axis"))), _AXES["X"])
        )
        if prim.IsA(UsdPhysics.RevoluteJoint):
            return (self._limited(prim, "angular", axis),)
        if prim.IsA(UsdPhysics.PrismaticJoint):
            return (self._limited(prim, "linear", axis),)
        if prim.IsA(UsdPhysics.SphericalJoint):
            return (Freedom("rot", "spherical", axis, 1.0),)
        return () if prim.IsA(UsdPhysics.FixedJoint) else self._generic(prim)

    def _limited(self, prim: Any, token: str, axis: NdArray) -> Freedom:
        """The one freedom of a revolute or prismatic joint."""
        low, high = (
            self._bound(prim, f"physics:{end}Limit", sign)
            for end, sign in (("lower", -1), ("upper", 1))
        )
        if low > high:
            self.context.note(prim, "its lower limit is above its upper one: it has none")
            low, high = -math.inf, math.inf
        return self._freedom(token, axis, low, high)

    def _freedom(self, token: str, axis: NdArray, low: float, high: float) -> Freedom:
        if token == "linear" or token in _SLIDES:
            metres = self.context.model.metres_per_unit
            return Freedom(token, "prismatic", axis, metres, low * metres, high * metres)
        kind = "continuous" if math.isinf(low) and math.isinf(high) else "revolute"
        return Freedom(token, kind, axis, math.pi / 180, math.radians(low), math.radians(high))

    def _generic(self, prim: Any) -> tuple[Freedom, ...]:
        """Freedoms of a joint whose limits leave them open: slides first, then turns by X, Y, Z."""
        free = []
        for token in (*_SLIDES, *_TURNS):
            low = self._bound(prim, f"limit:{token}:physics:low", -1)
            high = self._bound(prim, f"limit:{token}:physics:high", 1)
            if low < high:
                axis = np.array(_AXES[token[-1]])
                free.append(self._freedom(token, axis, low, high))
        turns = [one for one in free if one.token in _TURNS]
        if len(turns) == 3 and all(one.kind == "continuous" for one in turns):
            whole = Freedom("rot", "spherical", turns[0].axis, 1.0)
            free = [*(one for one in free if one.kind == "prismatic"), whole]
        return tuple(free)

    def _bound(self, prim: Any, name: str, sign: int) -> float:
        found = self.context.value(prim.GetAttribute(name))
        if found is None or math.isnan(found) or abs(found) > _ENDLESS:
            return sign * math.inf
        return float(found)


def rigid(matrix: NdArray) -> NdArray:
    """(4, 4): its place, and the rotation that is nearest to it (Higham 1986)."""
    u, _, v = np.linalg.svd(matrix[:3, :3])
    out = np.eye(4)
    out[:3, :3] = u @ v * np.sign(np.linalg.det(u @ v))
    out[:3, 3] = matrix[:3, 3]
    return out


def _body(prim: Any) -> Any:
    """The rigid body that a prim belongs to; None: it stands still."""
    while prim and not prim.IsPseudoRoot():
        api = UsdPhysics.RigidBodyAPI(prim)
        if (
            prim.HasAPI(UsdPhysics.RigidBodyAPI)
            and api.GetRigidBodyEnabledAttr().Get() is not False
        ):
            return prim
        prim = prim.GetParent()
    return None


def goes_on(pair: list[Found], joint: Found) -> bool:
    """True if a joint is one more of those that move one body in the other together, as exporters
    of MuJoCo write them: each of one axis, and all with the body in the same place."""
    several = [*pair, joint]
    places = [one.frames[0] @ np.linalg.inv(one.frames[1]) for one in several]
    one_axis = all(
        len(one.freedoms) == 1 and one.freedoms[0].kind != "spherical" for one in several
    )
    return one_axis and bool(np.abs(places[-1] - places[0]).max() < _SAME)
