"""A scene read back: its objects as the messages that make them. Used by the writers of files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, dtype_of
from ..usd.model import Notes

SHARED = ("texture", "material", "mesh", "volume")  #: kinds of objects that entities share


@dataclass
class Entity:
    """An entity. parent: the key of another one, None: the world."""

    key: int
    name: str
    message: pb.Entity
    parent: int | None = None
    children: list[int] = field(default_factory=list)

    @property
    def is_mesh(self) -> bool:
        return key_of(self.message.mesh) is not None

    @property
    def is_hidden(self) -> bool:
        """True if the entity is hidden by itself; one above may hide it, too."""
        return self.message.HasField("visible") and not self.message.visible

    @property
    def title(self) -> str:
        """Its name in notes."""
        return self.name or f"entity {self.key}"


@dataclass
class Shared:
    """A texture, material, mesh or volume."""

    name: str
    message: Any


def key_of(ref: types.Ref) -> int | None:
    """The key of the object that a Ref of a scene file names; None: nothing."""
    return ref.created_by_edit if ref.WhichOneof("target") == "created_by_edit" else None


@dataclass(frozen=True)
class Dome:
    """Light from infinitely far. color: (3,) radiance, times the texture's. rotation: (3, 3)
    world_from_dome."""

    color: NdArray
    texture: int | None
    rotation: NdArray
    camera_visible: bool


@dataclass
class World:
    """Scene by keys. entities: parents before their children. time: seconds. notes: features that a
    file lacks."""

    name: str
    blobs: dict[bytes, bytearray]
    default_material: pb.Material
    entities: dict[int, Entity] = field(default_factory=dict)
    shared: dict[int, Shared] = field(default_factory=dict)
    dome: Dome | None = None
    time: float = 0.0
    notes: Notes = field(default_factory=Notes)

    def array(self, message: types.Array) -> NdArray:
        """Read-only, as the daemon has it."""
        held = message.WhichOneof("source") == "blob"
        data = self.blobs[message.blob] if held else message.inline
        return np.frombuffer(data, dtype_of(message.dtype)).reshape(tuple(message.shape))

    def optional(self, owner: Any, name: str) -> NdArray | None:
        """An array of a message that may not have it."""
        return self.array(getattr(owner, name)) if owner.HasField(name) else None

    @cached_property
    def joints(self) -> set[int]:
        """Keys of entities that skins follow."""
        skins = (entity.message.skin for entity in self.entities.values())
        return {key for skin in skins for key in map(key_of, skin.joints) if key is not None}

    def is_skin_alone(self, entity: Entity) -> bool:
        """True if nothing of an entity depends on its own pose."""
        message = entity.message
        others = any(message.HasField(name) for name in ("camera", "light", "portal"))
        is_needed = entity.children or others or entity.key in self.joints
        return entity.is_mesh and message.HasField("skin") and not is_needed

    def shows(self, entity: Entity) -> bool:
        """True if neither the entity nor one above it is hidden."""
        while not entity.is_hidden and entity.parent is not None:
            entity = self.entities[entity.parent]
        return not entity.is_hidden


def read(name: str, chunks: Iterable[service.SceneChunk], default_material: pb.Material) -> World:
    """World of the answer to an ExportScene. default_material: with values of all parameters."""
    header, blobs = _received(chunks)
    world = World(name, blobs, default_material)
    found: dict[int, Entity] = {}
    for number, edit in enumerate(header.transaction.edits):
        _take(world, found, number, edit)
    for entity in found.values():
        entity.parent = key_of(entity.message.parent)
        _leave_out_curves(world, entity)
    _put_in_order(world, found)
    return world


def _leave_out_curves(world: World, entity: Entity) -> None:
    mesh = key_of(entity.message.mesh)
    if mesh is None or not world.shared[mesh].message.HasField("curves"):
        return
    world.notes.add(entity.title, "curves are left out")
    for name in ("mesh", "materials", "skin", "morph_weights"):
        entity.message.ClearField(name)


def _received(chunks: Iterable[service.SceneChunk]) -> tuple[Any, dict[bytes, bytearray]]:
    header, pieces, data = service.SceneChunk.Header(), b"", bytearray()
    blobs: dict[bytes, bytearray] = {}
    for chunk in chunks:
        part = chunk.WhichOneof("part")
        if part == "header_chunk":
            pieces += chunk.header_chunk
            continue
        if part == "header":
            header = chunk.header
            continue
        if pieces:
            header, pieces = service.SceneChunk.Header.FromString(pieces), b""
        data += chunk.chunk
        if len(data) == header.sizes[len(blobs)]:
            blobs[header.blobs[len(blobs)]], data = data, bytearray()
    return (service.SceneChunk.Header.FromString(pieces) if pieces else header), blobs


def _take(world: World, found: dict[int, Entity], number: int, edit: pb.Edit) -> None:
    """Takes an object that an edit makes, or the components that it adds to one."""
    kind = edit.WhichOneof("action")
    if kind == "settings":
        world.time = edit.settings.time
        world.dome = _dome(world, edit.settings.dome)
    elif kind in SHARED:
        world.shared[number] = Shared(edit.target.name, getattr(edit, kind))
    elif kind == "entity" and edit.mode == pb.Edit.MODE_UPDATE:
        found[edit.target.created_by_edit].message.MergeFrom(edit.entity)
    elif kind == "entity":
        found[number] = Entity(number, edit.target.name, edit.entity)


def _dome(world: World, message: pb.Dome) -> Dome | None:
    """None: there is no light from it."""
    texture, rotation = key_of(message.texture), world.optional(message, "rotation")
    color = np.full(3, 0.0 if texture is None else 1.0)
    if message.HasField("color"):
        color = np.array([message.color.x, message.color.y, message.color.z], "f8")
    color = color * (message.intensity if message.HasField("intensity") else 1.0)
    if not color.any():
        return None
    visible = message.camera_visible or not message.HasField("camera_visible")
    return Dome(color, texture, np.eye(3) if rotation is None else rotation, visible)


def _put_in_order(world: World, found: dict[int, Entity]) -> None:
    """Fills world.entities, parents first."""
    for entity in found.values():
        if entity.parent is not None:
            found[entity.parent].children.append(entity.key)
    waiting = [entity.key for entity in reversed(found.values()) if entity.parent is None]
    while waiting:
        key = waiting.pop()
        world.entities[key] = found[key]
        waiting += reversed(found[key].children)
