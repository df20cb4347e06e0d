"""Shapes of the scene's entities, read back once. Used by randomizers that place things."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray, checked
from ..errors import InvalidArgument
from ..scene.handles import Entity, Material, Mesh, Named, flatten

if TYPE_CHECKING:
    from ..client.scene import Scene
    from .draw import Draw

_ENTITY = 1  # kind in the upper byte of an id


class Body:
    """An entity with all below it, as the scene has them.

    root: its handle. meshes: the entities at or below it that have a mesh. positions: (V, 3)
    float64 in the root's frame, the rest shape. triangles: (F, 3). radius: metres in that frame,
    of the ball about the middle of its box that contains it.
    """

    def __init__(self, root: Entity, meshes: Sequence[Entity], parts: Sequence[Any]) -> None:
        self.root = root
        self.meshes = list(meshes)
        starts = np.cumsum([0, *(len(positions) for positions, _ in parts)])
        self.positions: NdArray = np.concatenate([positions for positions, _ in parts])
        self.triangles: NdArray = np.concatenate(
            [triangles + start for (_, triangles), start in zip(parts, starts)]
        )

    def world(self, pose: NdArray) -> NdArray:
        """(V, 3): its vertices where the root has that pose."""
        return np.asarray(self.positions @ pose[:3, :3].T + pose[:3, 3])


class Bodies:
    """Bodies of one scene by their roots, each read once. Thread: one at a time."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._bodies: dict[int, Body] = {}
        self._arrays: dict[int, tuple[NdArray, NdArray]] = {}
        self._materials: dict[int, Material | None] = {}
        self._children: dict[int, list[int]] | None = None

    def of(self, things: Any, field: str) -> list[Body]:
        """The bodies of entities, groups and assets; InvalidArgument where there is no mesh."""
        handles = [self._handle(thing, field) for thing in flatten(things, field)]
        for handle in handles:
            if handle.id not in self._bodies:
                self._bodies[handle.id] = self._read(handle, field)
        return [self._bodies[handle.id] for handle in handles]

    def some(self, things: Any, field: str) -> list[Body]:
        """Bodies of one thing or more; InvalidArgument for none."""
        bodies = self.of(things, field)
        if not bodies:
            raise InvalidArgument(f"{field}: is empty; name one entity or more", field=field)
        return bodies

    def material_of(self, thing: Any) -> Material | None:
        """The material of an entity's first part."""
        handle = self._handle(thing, "things")
        if handle.id not in self._materials:
            self._materials[handle.id] = handle.material
        return self._materials[handle.id]

    def _handle(self, thing: Named, field: str) -> Entity:
        handle = self.scene[thing] if isinstance(thing, str) else thing
        if not isinstance(handle, Entity):
            raise InvalidArgument(f"{field}: needs entities, not {handle!r}", field=field)
        return handle

    def _below(self, root: int) -> list[int]:
        """The ids of an entity and all below it."""
        if self._children is None:
            self._children = {}
            for found in self.scene.describe(tree=True).objects:
                if found.id >> 56 == _ENTITY:
                    self._children.setdefault(found.parent, []).append(found.id)
        out = [root]
        for id in out:
            out.extend(self._children.get(id, ()))
        return out

    def _read(self, root: Entity, field: str) -> Body:
        entities = [self.scene.handle(id) for id in self._below(root.id)]
        rows = self.scene.read(entities, ["world_pose", "entity"])
        root_from_world = np.linalg.inv(np.asarray(rows[0][0], dtype="f8"))
        meshes, parts = [], []
        for entity, (world, message) in zip(entities, rows):
            ref = message.entity.mesh
            if not (ref.id or ref.name):
                continue
            positions, triangles = self._mesh(self.scene.handle(ref.id or ref.name))
            if len(triangles) == 0:
                continue
            pose = root_from_world @ np.asarray(world, dtype="f8")
            meshes.append(entity)
            parts.append((positions @ pose[:3, :3].T + pose[:3, 3], triangles))
        if not meshes:
            raise InvalidArgument(
                f"{field}: {root!r} has no mesh, nor has anything below it", field=field
            )
        return Body(root, meshes, parts)

    def _mesh(self, mesh: Mesh) -> tuple[NdArray, NdArray]:
        if mesh.id not in self._arrays:
            positions = np.asarray(mesh.positions, dtype="f8").reshape(-1, 3)
            self._arrays[mesh.id] = positions, np.asarray(mesh.indices, dtype="i8")
        return self._arrays[mesh.id]


def middle(draw: Draw, target: Any, field: str = "target") -> NdArray:
    """(3,) the middle of the world box of entities as drawn so far; or the point that it is."""
    listed = isinstance(target, (tuple, list, np.ndarray)) and len(target) == 3
    if listed and all(isinstance(x, (int, float, np.number)) for x in target):
        return checked(target, field, "f8", (3,))
    bodies = draw.bodies.some(target, field)
    corners = [box_of(body.world(draw.pose(body.root))) for body in bodies]
    low = np.min([low for low, _ in corners], axis=0)
    return np.asarray(0.5 * (low + np.max([high for _, high in corners], axis=0)))


def box_of(points: NdArray) -> tuple[NdArray, NdArray]:
    """Lower and upper corner."""
    return points.min(axis=0), points.max(axis=0)


@contextmanager
def published(draw: Draw) -> Iterator[Scene]:
    """A branch of the scene where the edits drawn so far are published, so that queries see them:
    they do not look into overlays."""
    branch = draw.scene.branch()
    try:
        if draw.edit.transaction.edits:
            branch.apply(draw.edit.transaction)
        yield branch
    finally:
        branch.delete()
