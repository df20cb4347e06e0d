"""Meshes of a labelled instance, and their poses in its frame. Read from the scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..._wire._proto import scene_pb2 as pb
from ..._wire.arrays import NdArray
from ...client.scene import Scene
from ...errors import InvalidArgument
from ...scene.handles import KINDS, Entity, Named
from ..writer import Image
from .instances import Instance, instances


@dataclass(frozen=True)
class Part:
    """A mesh, by its id, and the pose of its coordinates, (4, 4). deforms: by a skin or morphs."""

    mesh: int
    pose: NdArray
    deforms: bool


def shapes_of(
    scene: Scene, camera: Named, categories: Sequence[str] | None
) -> Iterator[tuple[Instance, list[Part]]]:
    """The scene's instances of these categories, by category and label, with their parts in the
    object frame, metres."""
    frame = scene.render(camera, planes=["instance"], labels=["boxes"], size=(16, 16))
    found = list(instances(frame, categories))
    found.sort(key=lambda i: (int(i.labels["category"][i.row]), i.label))
    parts = _parts_by_label(scene)
    for instance in found:
        if instance.label not in parts:
            raise InvalidArgument(
                f"{instance.name}: has no mesh, and its category wants one; leave the category "
                "out with categories=[...]",
                field="categories",
            )
        object_from_world = np.linalg.inv(instance.world_from_object)
        own = parts[instance.label]
        yield instance, [replace(part, pose=object_from_world @ part.pose) for part in own]


def shown_entities(scene: Scene) -> list[Entity]:
    """Entities that show a mesh: they and all they hang on are visible."""
    own, parents = _entities(scene)
    out = []
    for id, (handle, entity, _) in own.items():
        at = id
        while at and own[at][1].visible:
            at = parents[at]
        if entity.mesh.id and not at:
            out.append(handle)
    return out


def crowds_of(scene: Scene) -> set[int]:
    """The labels that several entities share, group=True."""
    own, _ = _entities(scene)
    return {entity.label.value for _, entity, _ in own.values() if entity.label.group}


def crowds_drawn(transaction: pb.Transaction) -> set[int]:
    """Labels of the crowds that an overlay makes."""
    entities = [
        edit.instances.prototype if edit.HasField("instances") else edit.entity
        for edit in transaction.edits
    ]
    return {entity.label.value for entity in entities if entity.label.group}


def crowds_in(image: Image, of_scene: set[int]) -> set[int]:
    """Labels of the crowds of an image. of_scene: crowds_of() its scene."""
    drawn = set() if image.overlay is None else crowds_drawn(image.overlay.transaction)
    return of_scene | drawn


def _parts_by_label(scene: Scene) -> dict[int, list[Part]]:
    """Label to parts in the world. An entity without a label has that of its parent."""
    own, parents = _entities(scene)
    out: dict[int, list[Part]] = {}
    for id, (_, entity, pose) in own.items():
        at = id
        while at and not own[at][1].label.HasField("value"):
            at = parents[at]
        label = own[at][1].label.value if at else 0
        if label and entity.mesh.id:
            deforms = entity.HasField("skin") or entity.HasField("morph_weights")
            out.setdefault(label, []).append(Part(entity.mesh.id, pose, deforms))
    return out


def _entities(scene: Scene) -> tuple[dict[int, tuple[Entity, pb.Entity, NdArray]], dict[int, int]]:
    """Id to handle, message and world pose (4, 4) of all entities; id to the parent's, 0: none."""
    objects = [o for o in scene.describe(tree=True).objects if KINDS.get(o.id >> 56) is Entity]
    handles = [Entity(scene, o.name, o.id) for o in objects]
    rows = scene.read(handles, ["entity", "world_pose"]) if handles else []
    own = {
        handle.id: (handle, edit.entity, np.asarray(pose, np.float64).reshape(4, 4))
        for handle, (edit, pose) in zip(handles, rows)
    }
    return own, {o.id: o.parent for o in objects}
