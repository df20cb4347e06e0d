"""MJCF files to bodies, joints and keyframes. Used by edits.py.

Source: MuJoCo's manual, "Computation" (kinematics) and "XML Reference"; mjModel in mjmodel.h.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._optional import needed
from ..._wire.arrays import NdArray
from ...errors import InvalidArgument, NotFound
from ..description import Joint, RobotModel

WORLD = "world"  # as MuJoCo names the body that all others are in


def mujoco() -> Any:
    return needed("mujoco", "MJCF files need", "mjcf")


@dataclass(frozen=True, eq=False)
class Compiled:
    """An MjModel, and where all of it is at qpos0. name: of the file, or of the model."""

    name: str
    model: Any
    data: Any

    def names(self, kind: str, count: int) -> list[str]:
        """Names of all objects of a kind ("geom"); of those without one the kind and the number."""
        lib = mujoco()
        found = [lib.mj_id2name(self.model, _kind(kind), i) for i in range(count)]
        return [name or f"{kind}{i}" for i, name in enumerate(found)]


def _kind(kind: str) -> Any:
    return getattr(mujoco().mjtObj, f"mjOBJ_{kind.upper()}")


def compiled(source: Any) -> Compiled:
    """Compiles a file's path, an MjModel or an MjSpec. InvalidArgument."""
    lib = mujoco()
    name, model = "", source
    if isinstance(source, (str, os.PathLike)):
        name, model = Path(source).stem, _from_file(lib, Path(source))
    elif hasattr(source, "compile"):
        model = source.compile()
    if not isinstance(model, lib.MjModel):
        raise InvalidArgument(
            f"path: needs a file's path, a mujoco.MjModel or an MjSpec, not {source!r}",
            field="path",
        )
    own = bytes(model.names).split(b"\0", 1)[0].decode(errors="replace")
    named = own if own and own != "MuJoCo Model" else name
    return Compiled(named or "mjcf", model, at_values(model, model.qpos0))


def at_values(model: Any, qpos: NdArray) -> Any:
    """An MjData with bodies, cameras, lights and tendons where they are at qpos (nq,)."""
    lib = mujoco()
    data = lib.MjData(model)
    data.qpos[:] = qpos
    for stage in (lib.mj_kinematics, lib.mj_comPos, lib.mj_camlight, lib.mj_tendon):
        stage(model, data)
    return data


def camera_at(data: Any, camera: int) -> NdArray:
    """(4, 4) world_from_camera."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = data.cam_xmat[camera].reshape(3, 3), data.cam_xpos[camera]
    return out


def _from_file(lib: Any, path: Path) -> Any:
    if not path.is_file():
        raise NotFound(f"no file {path}", field="path")
    try:
        if path.suffix == ".mjb":
            return lib.MjModel.from_binary_path(str(path))
        return lib.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InvalidArgument(f"{path}: MuJoCo refuses it: {error}", field="path") from None


def robot_model(source: Compiled, visuals: dict[int, list[Any]]) -> RobotModel:
    """visuals: by body."""
    model = source.model
    bodies = body_names(source)
    links, joints = [bodies[0]], list[Joint]()
    names = source.names("joint", model.njnt)
    for body in range(1, model.nbody):
        chain = list(_chain(model, body, bodies, names))
        joints += chain
        links += [joint.child for joint in chain]
    seen = {link: list[Any]() for link in links}
    for body, found in visuals.items():
        seen[bodies[body]] = found
    keys = source.names("key", model.nkey)
    keyframes = {key: model.key_qpos[i].copy() for i, key in enumerate(keys)}
    warnings = _left_out(source)
    return RobotModel(
        source.name,
        links,
        seen,
        joints,
        warnings=warnings,
        soft_limits=True,
        keyframes=keyframes,
    )


def body_names(source: Compiled) -> list[str]:
    return [WORLD, *source.names("body", source.model.nbody)[1:]]


def pose(position: Any, quaternion: Any) -> NdArray:
    """(4, 4) of a position and a quaternion w x y z."""
    out = np.eye(4)
    flat = np.empty(9)
    mujoco().mju_quat2Mat(flat, np.asarray(quaternion, "f8"))
    out[:3, :3], out[:3, 3] = flat.reshape(3, 3), position
    return out


def _shift(by: Any) -> NdArray:
    out = np.eye(4)
    out[:3, 3] = by
    return out


def _chain(model: Any, body: int, bodies: list[str], names: list[str]) -> Iterator[Joint]:
    """The joints between a body and its parent, one below the other: where there are several, or
    one that is not in the body's origin, there are links without mass in between."""
    parent, at = bodies[model.body_parentid[body]], np.zeros(3)
    origin = pose(model.body_pos[body], model.body_quat[body])
    first, x = model.body_jntadr[body], np.array([1.0, 0, 0])
    own = range(first, first + model.body_jntnum[body])
    for j in own:
        joint = _joint(model, j, names[j], parent, f"{bodies[body]}:{names[j]}")
        if joint.kind == "floating":
            yield Joint(**{**vars(joint), "child": bodies[body]})
            return
        here = model.jnt_pos[j]
        origin, at = origin @ _shift(here - at), here
        if j == own[-1] and not at.any():
            yield Joint(**{**vars(joint), "origin": origin, "child": bodies[body]})
            return
        yield Joint(**{**vars(joint), "origin": origin})
        parent, origin = joint.child, np.eye(4)
    name = f"{bodies[body]}:fixed"
    yield Joint(name, "fixed", parent, bodies[body], origin @ _shift(-at), x)


def _joint(model: Any, j: int, name: str, parent: str, child: str) -> Joint:
    kinds = mujoco().mjtJoint
    kind, adr = model.jnt_type[j], model.jnt_qposadr[j]
    if kind == kinds.mjJNT_FREE or kind == kinds.mjJNT_BALL:
        is_free = kind == kinds.mjJNT_FREE
        rest = tuple(model.qpos0[adr : adr + (7 if is_free else 4)].tolist())
        what = "floating" if is_free else "spherical"
        return Joint(name, what, parent, child, np.eye(4), model.jnt_axis[j].copy(), rest=rest)
    limited = bool(model.jnt_limited[j])
    what = "revolute" if limited else "continuous"
    if kind == kinds.mjJNT_SLIDE:
        what = "prismatic"
    lower, upper = model.jnt_range[j].tolist() if limited else (-np.inf, np.inf)
    rest, axis = (float(model.qpos0[adr]),), model.jnt_axis[j].copy()
    return Joint(name, what, parent, child, np.eye(4), axis, lower, upper, rest=rest)


def _left_out(source: Compiled) -> list[str]:
    model, out = source.model, []
    for name in source.names("flex", model.nflex):
        out.append(f"flex {name!r} is left out: deformable bodies are not read")
    if model.neq:
        out.append(
            f"{model.neq} equality constraints are not kept: joints follow their values; "
            "give those of a simulation"
        )
    return out
