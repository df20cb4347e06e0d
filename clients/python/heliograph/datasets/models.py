"""Models of labelled instances, read back from the scene: for formats that bring meshes along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._arrays import NdArray, from_message
from ..errors import InvalidArgument
from ..handles import KINDS, Entity, Named
from ..scene import Scene
from .instances import Instance, instances

_SAME = 1e-4  # of a model's size: what is nearer is equal
_MM = 1000.0
_PAIRS = 1 << 22  # distances at a time


@dataclass(frozen=True)
class Symmetry:
    """A motion that maps an object onto itself, in its frame, metres: a (4, 4) matrix, or any
    rotation about an axis, (3,) of length 1, through a point, (3,)."""

    matrix: NdArray | None = None
    axis: NdArray | None = None
    point: NdArray | None = None


def symmetries_info(symmetries: Sequence[Symmetry], origin: NdArray, unit: float) -> dict[str, Any]:
    """`symmetries_discrete` and `symmetries_continuous` as BOP and DOPE have them, about an origin
    in the object frame, in units of 1 / unit metres."""
    moved = np.eye(4)
    moved[:3, 3] = -origin
    discrete, continuous = [], []
    for symmetry in symmetries:
        if symmetry.matrix is not None:
            matrix = moved @ symmetry.matrix @ np.linalg.inv(moved)
            matrix[:3, 3] *= unit
            discrete.append(_plain(matrix.ravel()))
        elif symmetry.axis is not None:
            point = symmetry.point - origin
            point = unit * (point - symmetry.axis * (point @ symmetry.axis))
            continuous.append({"axis": _plain(symmetry.axis), "offset": _plain(point)})
    both = {"symmetries_discrete": discrete, "symmetries_continuous": continuous}
    return {name: found for name, found in both.items() if found}


@dataclass(frozen=True)
class Model:
    """The mesh of one or more instances in the frame of BOP's models: the object frame, moved to
    the centre of the box. positions: (V, 3) float32 mm; center, half: (3,) metres, object frame."""

    id: int
    category: str
    center: NdArray
    half: NdArray
    positions: NdArray
    indices: NdArray
    normals: NdArray | None
    symmetries: Sequence[Symmetry] = ()

    @property
    def object_from_model(self) -> NdArray:
        """(4, 4) float64, metres."""
        out = np.eye(4)
        out[:3, 3] = self.center
        return out

    def check(self, instance: Instance) -> None:
        """Refuses an instance that a frame shows with another shape or size."""
        center = instance.labels["box_center"][instance.row]
        half = instance.labels["box_half_extents"][instance.row]
        off = max(np.abs(center - self.center).max(), np.abs(half - self.half).max())
        if off > _SAME * self.half.max():
            raise InvalidArgument(
                f"{instance.name}: its box is {2 * half} m at {center}, that of its model "
                f"{self.id} {2 * self.half} m at {self.center}; a pose with a model cannot say so: "
                "let draws leave the scale and the mesh as they are",
                field="scale",
            )

    def info(self) -> dict[str, Any]:
        """Its entry in models_info.json, millimetres."""
        low, high = self.positions.min(0), self.positions.max(0)
        out: dict[str, Any] = {"diameter": diameter(self.positions)}
        for i, axis in enumerate("xyz"):
            out[f"min_{axis}"] = float(low[i])
        for i, axis in enumerate("xyz"):
            out[f"size_{axis}"] = float(high[i] - low[i])
        return {**out, **symmetries_info(self.symmetries, self.center, _MM)}

    def ply(self) -> bytes:
        """A binary PLY file (Turk 1994) with positions in mm and, where all meshes have them,
        normals."""
        columns = [self.positions]
        names = ["x", "y", "z"]
        if self.normals is not None:
            columns.append(self.normals)
            names += ["nx", "ny", "nz"]
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(columns[0])}"]
        header += [f"property float {name}" for name in names]
        header += [f"element face {len(self.indices)}", "property list uchar int vertex_indices"]
        faces = np.empty(len(self.indices), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, self.indices
        text = "\n".join([*header, "end_header", ""]).encode()
        return text + np.hstack(columns).astype("<f4").tobytes() + faces.tobytes()


def diameter(points: NdArray) -> float:
    """The largest distance between two of (N, 3) points, over all pairs."""
    unique = np.unique(points, axis=0).astype(np.float64)
    unique = unique - unique.mean(0)
    squares = (unique**2).sum(1)
    best = 0.0
    step = max(1, _PAIRS // len(unique))
    for start in range(0, len(unique), step):
        part = slice(start, start + step)
        apart = squares[part, None] + squares[None, start:] - 2 * unique[part] @ unique[start:].T
        i, j = np.unravel_index(int(apart.argmax()), apart.shape)
        best = max(best, float(np.linalg.norm(unique[start + i] - unique[start + j])))
    return best


def models_of(
    scene: Scene, camera: Named, categories: Sequence[str] | None
) -> tuple[list[Model], dict[int, Model]]:
    """The models of the scene's instances of these categories, ids from 1 by category and label;
    and which label shows which."""
    frame = scene.render(camera, planes=["instance"], labels=["boxes"], size=(16, 16))
    found = list(instances(frame, categories))
    found.sort(key=lambda i: (int(i.labels["category"][i.row]), i.label))
    parts = _parts_of_labels(scene)
    models: list[Model] = []
    shapes: list[list[tuple[int, NdArray]]] = []
    of_label: dict[int, Model] = {}
    for instance in found:
        shape = _shape(instance, parts.get(instance.label, []))
        for known, model in zip(shapes, models):
            if model.category == instance.category and _same(shape, known, model):
                of_label[instance.label] = model
                break
        else:
            models.append(_model(scene, len(models) + 1, instance, shape))
            shapes.append(shape)
            of_label[instance.label] = models[-1]
    return models, of_label


def _parts_of_labels(scene: Scene) -> dict[int, list[tuple[int, NdArray]]]:
    """(mesh id, world_from_mesh) of all that each label is made of."""
    objects = [o for o in scene.describe(tree=True).objects if KINDS.get(o.id >> 56) is Entity]
    handles = [Entity(scene, o.name, o.id) for o in objects]
    rows = scene.read(handles, ["entity", "world_pose"]) if handles else []
    parents = {o.id: o.parent for o in objects}
    own = {o.id: row[0].entity for o, row in zip(objects, rows)}
    out: dict[int, list[tuple[int, NdArray]]] = {}
    for thing, (_, pose) in zip(objects, rows):
        at = thing.id
        while at and not own[at].label.HasField("value"):
            at = parents[at]
        mesh = own[thing.id].mesh.id
        if at and mesh and own[at].label.value:
            place = out.setdefault(own[at].label.value, [])
            place.append((mesh, np.asarray(pose, np.float64).reshape(4, 4)))
    return out


def _shape(instance: Instance, parts: list[tuple[int, NdArray]]) -> list[tuple[int, NdArray]]:
    """(mesh id, object_from_mesh)."""
    if not parts:
        raise InvalidArgument(
            f"{instance.name}: has no mesh, and its category wants a model; leave the category "
            "out with categories=[...]",
            field="categories",
        )
    object_from_world = np.linalg.inv(instance.world_from_object)
    return [(mesh, object_from_world @ pose) for mesh, pose in parts]


def _same(a: list[tuple[int, NdArray]], b: list[tuple[int, NdArray]], model: Model) -> bool:
    if [mesh for mesh, _ in a] != [mesh for mesh, _ in b]:
        return False
    size = np.array([1.0, 1.0, 1.0, model.half.max()])  # columns: directions, then the place
    return all((np.abs(p - q) <= _SAME * size).all() for (_, p), (_, q) in zip(a, b))


def _model(scene: Scene, id: int, instance: Instance, shape: list[tuple[int, NdArray]]) -> Model:
    positions: list[NdArray] = []
    normals: list[NdArray] = []
    indices: list[NdArray] = []
    for mesh, pose in shape:
        fields = ["mesh.positions", "mesh.normals", "mesh.indices"]
        points, directions, triangles = scene.read([scene.handle(mesh)], fields)[0]
        indices.append(triangles.astype(np.int64) + sum(len(p) for p in positions))
        positions.append(points @ pose[:3, :3].T + pose[:3, 3])
        if directions is not None and directions.size:
            turned = directions @ np.linalg.inv(pose[:3, :3])
            normals.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
    vertices = np.concatenate(positions)
    low, high = vertices.min(0), vertices.max(0)
    center = (low + high) / 2
    return Model(
        id=id,
        category=instance.category,
        center=center,
        half=(high - low) / 2,
        positions=((vertices - center) * _MM).astype(np.float32),
        indices=np.concatenate(indices),
        normals=np.concatenate(normals) if len(normals) == len(shape) else None,
        symmetries=_symmetries(scene, instance, shape),
    )


def _symmetries(
    scene: Scene, instance: Instance, shape: list[tuple[int, NdArray]]
) -> list[Symmetry]:
    """Those of its mesh but the identity. Of several meshes none's symmetry is the whole's."""
    if len(shape) != 1:
        return []
    mesh, pose = shape[0]
    linear, back = pose[:3, :3], np.linalg.inv(pose)
    out: list[Symmetry] = []
    for message in scene.read([scene.handle(mesh)], ["mesh"])[0][0].mesh.symmetries:
        if message.HasField("axis"):
            axis, offset = (np.array([v.x, v.y, v.z]) for v in (message.axis, message.offset))
            turned = linear @ axis
            point = linear @ offset + pose[:3, 3]
            out.append(Symmetry(axis=turned / np.linalg.norm(turned), point=point))
            _check_rotation(linear @ _rotation(axis) @ back[:3, :3], instance)
        else:
            matrix = pose @ from_message(message.matrix).astype(np.float64) @ back
            if not np.allclose(matrix, np.eye(4), atol=1e-6):
                out.append(Symmetry(matrix=matrix))
                _check_rotation(matrix[:3, :3], instance)
    return out


def _rotation(axis: NdArray) -> NdArray:
    """By one radian about an axis (Rodrigues 1840)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(1.0) * cross + (1 - np.cos(1.0)) * cross @ cross)


def _check_rotation(motion: NdArray, instance: Instance) -> None:
    off = np.abs(motion @ motion.T - np.eye(3)).max()
    if off > 1e-4 or np.linalg.det(motion) < 0:
        raise InvalidArgument(
            f"{instance.name}: a symmetry of its mesh is no rotation once its scale "
            f"{instance.labels['scale'][instance.row]} is applied; take it off the mesh or scale "
            "evenly",
            field="symmetries",
        )


def _plain(values: NdArray) -> list[float]:
    """For JSON; what rounding left of 0 is 0."""
    return [float(v) for v in np.round(values, 9) + 0.0]
