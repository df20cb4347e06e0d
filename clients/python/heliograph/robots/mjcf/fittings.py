"""Tendons as tubes, and skins. Used by building.py.

Source: MuJoCo's manual, "XML Reference", tendon/spatial and deformable/skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...values.skins import INFLUENCES, strongest
from .looks import look_of
from .reading import mujoco, pose

if TYPE_CHECKING:
    from ...scene.patches import Geometry
    from .building import MjcfBuilder

_AROUND = 8  # corners of a tube


def put(builder: MjcfBuilder, groups: Sequence[int]) -> None:
    model = builder.source.model
    for number, name in enumerate(builder.source.names("tendon", model.ntendon)):
        if model.tendon_group[number] in groups and model.tendon_rgba[number, 3] > 0:
            _put_tendon(builder, number, name)
    for number, name in enumerate(builder.source.names("skin", model.nskin)):
        if model.skin_group[number] in groups and model.skin_rgba[number, 3] > 0:
            _put_skin(builder, number, name)


# ------------------------------------------------------------ tendons


def _put_tendon(builder: MjcfBuilder, number: int, name: str) -> None:
    """Puts a tendon, each point of which goes with its body, so that straight pieces follow the
    joints."""
    model, data = builder.source.model, builder.source.data
    points, bodies, is_wrapped = _path(model, data, number)
    if not len(points):
        return
    if is_wrapped:
        builder.robot.warnings.append(
            f"tendon {name!r} winds around a geom: where it does so is that of qpos0"
        )
    used, joints = np.unique(bodies, return_inverse=True)
    mesh: Any = _tubes(points, joints.reshape(bodies.shape), float(model.tendon_width[number]))
    binds = [np.linalg.inv(_of_body(data, body)) for body in used]
    builder.robot.tendons[name] = _put_skinned(
        builder,
        f"tendon/{name}",
        mesh,
        (used, binds),
        look_of(model, int(model.tendon_matid[number]), model.tendon_rgba[number]),
    )


def _path(model: Any, data: Any, number: int) -> tuple[NdArray, NdArray, bool]:
    """Straight pieces of a tendon at qpos0, (S, 2, 3) in the world; the bodies of their ends, (S,
    2); True if some wind around a geom."""
    first, count = int(data.ten_wrapadr[number]), int(data.ten_wrapnum[number])
    points = np.array(data.wrap_xpos).reshape(-1, 3)[first : first + count]
    objects = np.array(data.wrap_obj).ravel()[first : first + count]
    bodies = _bodies(model, number, objects)
    keep = [i for i in range(count - 1) if objects[i] != -2 and objects[i + 1] != -2]
    ends = np.array([[i, i + 1] for i in keep], int).reshape(-1, 2)
    return points[ends], bodies[ends], bool((objects >= 0).any())


def _bodies(model: Any, number: int, objects: NdArray) -> NdArray:
    """Body of each point of a tendon: a geom's, or that of the next site; -1 behind a pulley."""
    kinds = mujoco().mjtWrap
    first = int(model.tendon_adr[number])
    path = range(first, first + int(model.tendon_num[number]))
    sites = [int(model.wrap_objid[w]) for w in path if model.wrap_type[w] == kinds.mjWRAP_SITE]
    out, used = [], iter(sites)
    for found in objects:
        if found >= 0:
            out.append(int(model.geom_bodyid[found]))
        else:
            out.append(int(model.site_bodyid[next(used)]) if found == -1 else -1)
    return np.array(out, int)


def _tubes(points: NdArray, joints: NdArray, radius: float) -> Geometry:
    """A prism along each piece, both ends with joints of their own, closed by points."""
    along = points[:, 1] - points[:, 0]
    length = np.linalg.norm(along, axis=1)
    points, joints, along = points[length > 1e-9], joints[length > 1e-9], along[length > 1e-9]
    x = np.cross(along, np.eye(3)[np.abs(along).argmin(1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(along, x) / np.linalg.norm(along, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    sides = points[:, :, None] + radius * ring[:, None]
    vertices = np.concatenate([sides.reshape(len(points), -1, 3), points], axis=1)
    a, b = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    far, low, high = _AROUND, np.full(_AROUND, 2 * _AROUND), np.full(_AROUND, 2 * _AROUND + 1)
    columns = [(a, b, b + far), (a, b + far, a + far), (b, a, low), (a + far, b + far, high)]
    one = np.concatenate([np.column_stack(column) for column in columns])
    count = vertices.shape[1]
    of = np.concatenate([np.repeat(joints, _AROUND, axis=1), joints], axis=1).reshape(-1, 1)
    return {
        "positions": vertices.reshape(-1, 3),
        "indices": (one + count * np.arange(len(points))[:, None, None]).reshape(-1, 3),
        "joints": of * (1, 0, 0, 0),
        "weights": np.ones_like(of) * (1.0, 0, 0, 0),
    }


# ------------------------------------------------------------ skins


def _put_skin(builder: MjcfBuilder, number: int, name: str) -> None:
    model = builder.source.model
    first = int(model.skin_boneadr[number])
    bones = range(first, first + int(model.skin_bonenum[number]))
    binds = [
        np.linalg.inv(pose(model.skin_bonebindpos[b], model.skin_bonebindquat[b])) for b in bones
    ]
    mesh: Any = _skin_mesh(model, number)
    weights = _weights(model, number, bones)
    all_joints = np.broadcast_to(np.arange(weights.shape[1]), weights.shape)
    mesh["joints"], mesh["weights"] = strongest(all_joints, weights)
    if (np.sort(weights, axis=1)[:, :-INFLUENCES].sum(1) > 1e-3).any():
        builder.robot.warnings.append(
            f"skin {name!r} has vertices of more than {INFLUENCES} bones: the strongest "
            f"{INFLUENCES} count"
        )
    if model.skin_inflate[number]:
        builder.robot.warnings.append(f"skin {name!r}: inflate is left out")
    material = int(model.skin_matid[number])
    look = look_of(model, material, model.skin_rgba[number])
    bodies = np.array([model.skin_bonebodyid[b] for b in bones])
    builder.robot.skins[name] = _put_skinned(builder, f"skin/{name}", mesh, (bodies, binds), look)


def _skin_mesh(model: Any, number: int) -> dict[str, Any]:
    start, count = int(model.skin_vertadr[number]), int(model.skin_vertnum[number])
    faces = slice(
        int(model.skin_faceadr[number]),
        int(model.skin_faceadr[number]) + int(model.skin_facenum[number]),
    )
    positions = np.array(model.skin_vert[start : start + count], "f8")
    indices = np.array(model.skin_face[faces])
    out = {"positions": positions, "indices": indices, "normals": _normals(positions, indices)}
    coordinates = int(model.skin_texcoordadr[number])
    if coordinates >= 0:
        uvs = np.array(model.skin_texcoord[coordinates : coordinates + count])
        out["uvs"] = uvs * (1, -1) + (0, 1)
    return out


def _normals(positions: NdArray, indices: NdArray) -> NdArray:
    """(V, 3): means of the faces about each vertex, by their areas."""
    a, b, c = np.moveaxis(positions[indices], 1, 0)
    across = np.cross(b - a, c - a)
    out = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(out, indices[:, corner], across)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(length > 0, out / np.where(length > 0, length, 1), (0, 0, 1.0))


def _weights(model: Any, number: int, bones: range) -> NdArray:
    """(V, J)."""
    out = np.zeros((int(model.skin_vertnum[number]), len(bones)))
    for j, bone in enumerate(bones):
        first = int(model.skin_bonevertadr[bone])
        own = slice(first, first + int(model.skin_bonevertnum[bone]))
        out[model.skin_bonevertid[own], j] = model.skin_bonevertweight[own]
    return out


# ------------------------------------------------------------ both


def _of_body(data: Any, body: int) -> NdArray:
    return pose(data.xpos[body], data.xquat[body])


def _put_skinned(
    builder: MjcfBuilder, name: str, mesh: Any, skin: tuple[NdArray, list[NdArray]], look: Any
) -> Any:
    """An entity beneath the first of its bodies that is not the world; its mesh follows all."""
    bodies, binds = skin
    parent, part = builder.link(next((int(body) for body in bodies if body), 0))
    full = builder.free_name(f"{builder.robot.name}/{name}")
    return builder.edits.entity(
        full,
        exist_ok=False,
        parent=parent,
        part=part,
        mesh=builder.edits.mesh(f"{full}/mesh", exist_ok=False, **mesh),
        material=builder.shared.looks.material(builder.edits, look),
        skin=([builder.link(int(body))[0] for body in bodies], np.array(binds)),
    )
