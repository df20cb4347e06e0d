"""Handles of scene objects, and reading them back. Made by edits and by scene["name"]."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union, overload

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, from_message
from ..errors import FailedPrecondition, InvalidArgument, NotFound
from ..values.components import Camera
from ..values.lights import Light, Portal

if TYPE_CHECKING:
    from ..client.edit import Edits
    from ..client.scene import Scene


BY_NAME = -1  # Handle._index of an object that only its name denotes within its transaction


class Handle:
    """One object of a scene. Its id is known once its transaction was committed.

    Interchangeable with its name in every call; pickles as (address, scene, name or id).
    """

    kind = "object"

    def __init__(self, scene: Scene, name: str = "", id: int = 0) -> None:
        self.scene = scene
        self.name = name
        self._id = id
        self._edits: Edits | None = None  # the transaction that makes it, until it is committed
        self._index = 0

    @property
    def id(self) -> int:
        """Its 64-bit id."""
        if not self._id:
            self._id = self.scene.resolve(self._name_or_refuse(), self.kind)
        return self._id

    @property
    def known_id(self) -> int:
        """Its id, or 0 when that would take a call."""
        return self._id

    def _name_or_refuse(self) -> str:
        if self._edits is not None or not self.name:
            raise FailedPrecondition(
                f"this {self.kind} does not exist yet: leave the `with scene.edit()` block first"
            )
        return self.name

    def ref(self, within: Edits | None = None) -> types.Ref:
        """The Ref that names it in a request, or within its own transaction."""
        if within is not None and self._edits is within:
            by_name = self._index == BY_NAME
            return types.Ref(name=self.name) if by_name else types.Ref(created_by_edit=self._index)
        if self._id:
            return types.Ref(id=self._id)
        is_entity = type(self) in (Handle, Entity)  # others may share their name with one
        return types.Ref(name=self._name_or_refuse()) if is_entity else types.Ref(id=self.id)

    def _read(self, *fields: str) -> list[Any]:
        return self.scene.read([self], list(fields))[0]

    def __repr__(self) -> str:
        label = repr(self.name) if self.name else f"{self._id:#x}"
        return f"<{type(self).__name__} {label}>"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Handle) or self.scene.id != other.scene.id:
            return NotImplemented if not isinstance(other, Handle) else False
        if self._id and other._id:
            return self._id == other._id
        return bool(self.name) and self.name == other.name and self.kind == other.kind

    def __hash__(self) -> int:
        return hash((self.scene.id, self.name or self._id))

    def __reduce__(self) -> Any:
        if not self._id:
            self._name_or_refuse()
        return type(self), (self.scene, self.name, self._id)


class Entity(Handle):
    """A thing in the world. The properties ask the daemon each time."""

    kind = "entity"

    @property
    def transform(self) -> NdArray:
        """(4, 4) float32, parent_from_local at the scene's time."""
        return np.asarray(self._read("pose")[0])

    @property
    def world_transform(self) -> NdArray:
        """(4, 4) float32, world_from_local at the scene's time."""
        return np.asarray(self._read("world_pose")[0])

    @property
    def aabb(self) -> NdArray:
        """(2, 3) float32: lower and upper corner in the world, with its children, metres."""
        return np.asarray(self._read("aabb")[0])

    def _message(self) -> pb.Entity:
        found: pb.Entity = self._read("entity")[0].entity
        return found

    def _handle(self, ref: types.Ref) -> Any:
        target = ref.WhichOneof("target")
        if target is None or (target == "id" and ref.id == 0):
            return None
        return self.scene.handle(ref.name if target == "name" else ref.id)

    @property
    def parent(self) -> Entity | None:
        found: Entity | None = self._optional("parent")
        return found

    @property
    def mesh(self) -> Mesh | None:
        found: Mesh | None = self._optional("mesh")
        return found

    def _optional(self, field: str) -> Any:
        message = self._message()
        return self._handle(getattr(message, field)) if message.HasField(field) else None

    @property
    def materials(self) -> list[Any]:
        """The material of each part; the last one serves all further parts."""
        return [self._handle(ref) for ref in self._message().materials.parts]

    @property
    def material(self) -> Material | None:
        """The material of the first part."""
        bound = self.materials
        return bound[0] if bound else None

    @property
    def visible(self) -> bool:
        message = self._message()
        return message.visible if message.HasField("visible") else True

    @property
    def camera(self) -> Camera:
        """Its camera; NotFound without one."""
        message = self._message()
        if not message.HasField("camera"):
            raise NotFound(f"{self!r} has no camera: give it one with camera=hg.Camera...")
        return Camera.from_message(message.camera, self._read)

    @property
    def K(self) -> NdArray:
        """(3, 3) float64 intrinsics of its camera."""
        return self.camera.K

    @property
    def light(self) -> Light | None:
        message = self._message()
        found = message.HasField("light")
        return Light.from_message(message.light, self._handle) if found else None

    @property
    def portal(self) -> Portal | None:
        message = self._message()
        return Portal.from_message(message.portal) if message.HasField("portal") else None

    @property
    def light_group(self) -> str:
        """The light group of all its light."""
        return str(self._message().light_group)

    @property
    def attributes(self) -> dict[str, str]:
        return dict(self._message().attributes.values)


class Mesh(Handle):
    """A mesh of triangles or curves. Arrays are read-only copies of what it was given."""

    kind = "mesh"

    @property
    def positions(self) -> NdArray:
        """(V, 3) float32, mesh coordinates, metres; (K, V, 3) of a mesh with K times."""
        return np.asarray(self._read("mesh.positions")[0])

    @property
    def indices(self) -> NdArray:
        """(F, 3) uint32; none of curves, whose "mesh.curves" and "mesh.radii" scene.read() has."""
        return np.zeros((0, 3), "u4") if (found := self._array("mesh.indices")) is None else found

    @property
    def normals(self) -> NdArray | None:
        """(V, 3) float32, or (K, V, 3) of a mesh with K times; None: flat."""
        return self._array("mesh.normals")

    @property
    def uvs(self) -> NdArray | None:
        """(V, 2) float32; None: none."""
        return self._array("mesh.uvs")

    def _array(self, field: str) -> NdArray | None:
        found = self._read(field)[0]
        return None if found is None or found.size == 0 else np.asarray(found)


class Material(Handle):
    """A material that entities share."""

    kind = "material"

    @property
    def parameters(self) -> dict[str, Any]:
        """Name to number or (r, g, b); a parameter that a texture drives gives its factor."""
        message = self._read("material")[0].material
        out: dict[str, Any] = {}
        for field, value in message.ListFields():
            if isinstance(value, pb.ScalarParameter):
                out[field.name] = value.value
            elif isinstance(value, pb.ColorParameter):
                out[field.name] = (value.value.x, value.value.y, value.value.z)
        return out


class Texture(Handle):
    """An image with its sampler."""

    kind = "texture"


class Volume(Handle):
    """A medium that entities share: smoke, clouds, fire."""

    kind = "volume"

    @property
    def parameters(self) -> dict[str, Any]:
        """Name to number or (r, g, b), but for the grids."""
        message = self._read("volume")[0].volume
        out: dict[str, Any] = {}
        for field, value in message.ListFields():
            if field.name == "albedo":
                out[field.name] = (value.x, value.y, value.z)
            elif isinstance(value, float):
                out[field.name] = value
        return out


KINDS: dict[int, type[Handle]] = {1: Entity, 2: Mesh, 3: Material, 4: Texture, 5: Volume}
Named = Union[str, Handle]


class Group(Sequence[Entity]):
    """The entities "<name>/0" .. "<name>/N-1" that one edit created."""

    def __init__(self, entities: Sequence[Entity], name: str = "") -> None:
        self.name = name
        self._entities = list(entities)
        self._ids: tuple[NdArray, bytes] | None = None  # packed, and their SHA-256 once it is known

    @overload
    def __getitem__(self, index: int) -> Entity: ...
    @overload
    def __getitem__(self, index: slice) -> Group: ...
    def __getitem__(self, index: int | slice) -> Entity | Group:
        if isinstance(index, slice):
            return Group(self._entities[index], self.name)
        return self._entities[index]

    def __len__(self) -> int:
        return len(self._entities)

    def __repr__(self) -> str:
        return f"<Group {self.name!r} of {len(self)}>"


class Asset:
    """A decoded file and where it was placed.

    root: the first placement's root; roots: one a placement; entities: all of the first placement,
    its root first. meshes, materials, textures: by the names in the file. bounds: (2, 3) float32
    rest box, metres.
    """

    def __init__(self, scene: Scene, name: str, stem: str, info: Any) -> None:
        self.scene = scene
        self.name = name
        self.sha256 = bytes(info.sha256)
        self.animations: list[str] = list(info.animations)
        self.warnings: list[str] = list(info.warnings)
        self.bounds: NdArray | None = from_message(info.bounds) if info.HasField("bounds") else None
        self.roots: list[Entity] = []
        self._shared: dict[type[Handle], list[Handle]] = {}
        self.meshes: Mapping[str, Mesh] = self._library(Mesh, stem, info.meshes)
        self.materials: Mapping[str, Material] = self._library(Material, stem, info.materials)
        self.textures: Mapping[str, Texture] = self._library(Texture, stem, info.textures)
        self._names = list(info.entities)
        self._camera_names = set(info.cameras)
        self._placed: list[list[Entity]] = []

    def _library(self, kind: type[Handle], stem: str, names: Sequence[str]) -> Any:
        handles = [kind(self.scene, f"{stem}/{name}" if name else "") for name in names]
        self._shared[kind] = handles
        return Library(dict(zip(names, handles)), self, kind)

    @property
    def root(self) -> Entity:
        found: Entity = self._first(self.roots)
        return found

    @property
    def entities(self) -> Group:
        return Group(self._first(self._placed), self.root.name)

    @property
    def cameras(self) -> Group:
        """The entities of the first placement that have a camera."""
        pairs = zip(self._names, self._first(self._placed))
        return Group([entity for name, entity in pairs if name in self._camera_names])

    def _first(self, found: Sequence[Any]) -> Any:
        if not found:
            raise FailedPrecondition(f"{self!r} is placed nowhere: use edit.instance(asset)")
        return found[0]

    def place(self, root: Entity) -> Callable[[Sequence[int]], None]:
        """Notes a placement; the result takes the further ids of its Instantiate: the entities
        after the root, then the library in the file's order."""
        names = [f"{root.name}/{name}" if name else "" for name in self._names[1:]]
        entities = [root, *(Entity(self.scene, name) for name in names)]
        self.roots.append(root)
        self._placed.append(entities)

        def resolve(ids: Sequence[int]) -> None:
            give_ids(entities[1:], [i for i in ids if i >> 56 == _KIND_OF[Entity]])
            for kind, handles in self._shared.items():
                give_ids(handles, [i for i in ids if i >> 56 == _KIND_OF[kind]])

        return resolve

    def __len__(self) -> int:
        return len(self.roots)

    def __iter__(self) -> Iterator[Entity]:
        return iter(self.roots)

    def __repr__(self) -> str:
        return f"<Asset {self.name!r}, {len(self.roots)} placed>"


class Library(Mapping[str, Any]):
    """Shared objects of an asset, by the names in its file."""

    def __init__(self, handles: dict[str, Handle], asset: Asset, kind: type[Handle]) -> None:
        self.kind = kind
        self._handles = handles
        self._asset = asset

    def __getitem__(self, name: str) -> Handle:
        if name not in self._handles:
            have = ", ".join(map(repr, self._handles)) or "none"
            raise KeyError(f"{self._asset!r} has no {self.kind.kind} {name!r}; it has {have}")
        return self._handles[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._handles)

    def __len__(self) -> int:
        return len(self._handles)

    def __repr__(self) -> str:
        return f"<{self.kind.kind}s {', '.join(self._handles)}>"


_KIND_OF = {kind: number for number, kind in KINDS.items()}


def give_ids(handles: Sequence[Handle], ids: Sequence[int]) -> None:
    """After a commit."""
    for handle, number in zip(handles, ids):
        handle._edits, handle._id = None, number


def flatten(things: Any, field: str) -> list[Named]:
    """Handles and names of one thing, an asset, a group, or a nested sequence of these."""
    if isinstance(things, (str, Handle)):
        return [things]
    if isinstance(things, (Group, Asset, Sequence, Iterator)):
        return [leaf for thing in things for leaf in flatten(thing, field)]
    given = type(things).__name__
    raise InvalidArgument(f"{field}: needs a handle or a name, not {given}", field=field)
