"""Models of labelled instances, read back from the scene: for formats that bring meshes along."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...client.scene import Scene
from ...errors import InvalidArgument
from ...scene.handles import Named
from .instances import Instance
from .shapes import Part, shapes_of
from .symmetries import Symmetries, symmetries_of

_SAME = 1e-4  # of a model's size: nearer points are equal
_MM = 1000.0
_PAIRS = 1 << 19  # distances at a time, which fit caches


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
    symmetries: Symmetries

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
        return {**out, **self.symmetries.info(self.center, _MM)}

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
    """The largest distance between two of (N, 3) points.

    Of all pairs but those with a point so near the box's centre that it has no partner as far away
    as two points that are known.
    """
    unique = np.unique(points, axis=0).astype(np.float64)
    unique = unique - (unique.min(0) + unique.max(0)) / 2
    out = np.linalg.norm(unique, axis=1)
    known = np.linalg.norm(unique - unique[out.argmax()], axis=1).max()
    unique = unique[out + out.max() >= known]
    squares = (unique**2).sum(1, keepdims=True)
    ones = np.ones_like(squares)
    left, right = np.hstack([-2 * unique, squares, ones]), np.hstack([unique, ones, squares])
    best = float(known)
    step = max(1, _PAIRS // len(unique))
    for start in range(0, len(unique), step):
        apart = left[start : start + step] @ right[start:].T  # squares of distances
        i, j = np.unravel_index(int(apart.argmax()), apart.shape)
        best = max(best, float(np.linalg.norm(unique[start + i] - unique[start + j])))
    return best


def models_of(
    scene: Scene, camera: Named, categories: Sequence[str] | None
) -> tuple[list[Model], dict[int, Model]]:
    """The models of the scene's instances of these categories, ids from 1 by category and label;
    and which label shows which."""
    models: list[Model] = []
    shapes: list[list[Part]] = []
    of_label: dict[int, Model] = {}
    for instance, shape in shapes_of(scene, camera, categories):
        for part in shape:
            if part.deforms:
                raise InvalidArgument(
                    f"{instance.name}: its mesh deforms, and a pose with a model cannot say so; "
                    "leave its category out with categories=[...]",
                    field="categories",
                )
        for known, model in zip(shapes, models):
            if model.category == instance.category and _same(shape, known, model):
                of_label[instance.label] = model
                break
        else:
            models.append(_model(scene, len(models) + 1, instance, shape))
            shapes.append(shape)
            of_label[instance.label] = models[-1]
    return models, of_label


def _same(a: list[Part], b: list[Part], model: Model) -> bool:
    if [part.mesh for part in a] != [part.mesh for part in b]:
        return False
    size = np.array([1.0, 1.0, 1.0, model.half.max()])  # columns: directions, then the place
    return all((np.abs(p.pose - q.pose) <= _SAME * size).all() for p, q in zip(a, b))


def _model(scene: Scene, id: int, instance: Instance, shape: list[Part]) -> Model:
    positions: list[NdArray] = []
    normals: list[NdArray] = []
    indices: list[NdArray] = []
    fields = ["mesh.positions", "mesh.normals", "mesh.indices"]
    for part in shape:
        points, directions, triangles = scene.read([scene.handle(part.mesh)], fields)[0]
        linear = part.pose[:3, :3]
        if np.linalg.det(linear) < 0:  # mirrored: outside stays outside
            triangles = triangles[:, ::-1]
        indices.append(triangles.astype(np.int64) + sum(len(p) for p in positions))
        positions.append(points @ linear.T + part.pose[:3, 3])
        if directions is not None and directions.size:
            turned = directions @ np.linalg.inv(linear)
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
        symmetries=symmetries_of(scene, instance, shape),
    )
