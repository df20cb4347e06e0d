"""Edits: one atomic transaction, built by calls and sent when its `with` block ends.

Made by Scene.edit() and Scene.overlay().
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.arrays import MESSAGE_BYTES, NdArray
from .._wire.lent import GpuArray, Loan
from .._wire.uploads import Sources
from ..errors import FailedPrecondition, HeliographError, InvalidArgument
from ..robots.mjcf.edits import MjcfEdits
from ..robots.robot import RobotEdits
from ..scene import _poses, assets, images, patches, studio, volumes
from ..scene._domes import DomeEdits
from ..scene.handles import (
    BY_NAME,
    Asset,
    Entity,
    Group,
    Handle,
    Material,
    Mesh,
    Named,
    Texture,
    Volume,
    flatten,
    give_ids,
)
from ..usd.edits import UsdEdits
from ..values.checks import number_of, text_of, whole_of
from ..values.pose import packed_matrices

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .scene import Scene

_H = TypeVar("_H", bound=Handle)


class Edits(DomeEdits, RobotEdits, MjcfEdits, UsdEdits):
    """A list of edits; `with` sends them as one transaction, or drops them on an exception.

    In every call arguments that are given change, absent ones stay, None resets to the default; the
    object is created when its name is new; `exist_ok=False` only creates. Handles and names are
    interchangeable. Arrays are anything numpy accepts.
    """

    def __init__(self, scene: Scene, publish: bool, expected_revision: int | None = None) -> None:
        self.scene = scene
        self.revision = 0
        self.transaction = pb.Transaction()
        self.sources = Sources(owns=not publish)
        self._domes: list[str] = []
        self._publish = publish
        self._expected = expected_revision
        self._made: dict[int, Handle] = {}
        self._further: dict[int, Callable[[Sequence[int]], None]] = {}
        self._loans: list[Loan] = []  # of its arrays on a GPU, while it may be sent
        self._open = True

    def __enter__(self) -> Edits:
        return self

    def __exit__(self, kind: Any, value: Any, trace: Any) -> None:
        self._open = False
        if kind is None and self._publish:
            self.commit()
        elif kind is not None:
            self.sources.clear()

    def commit(self) -> None:
        """Sends the transaction; called by `with`."""
        self._open = False
        if not self.transaction.edits:
            return
        if self.transaction.ByteSize() > MESSAGE_BYTES:
            self.scene.client.store.lighten(self.transaction, self.sources)
        try:
            reply = self.sources.complete(self.scene.client, self._apply)
        except HeliographError as error:
            raise patches.explained(error, self.transaction) from None
        finally:
            self.sources.clear()
        self.revision = reply.revision
        self._resolve(reply)

    def _resolve(self, reply: service.ApplyReply) -> None:
        """Gives the handles their ids."""
        ids = np.frombuffer(reply.ids, "<u8").tolist()
        further = len(self.transaction.edits)
        for index in range(len(self.transaction.edits)):
            handle = self._made.get(index)
            if handle is not None:
                handle._edits, handle._id = None, ids[index]
            count = reply.counts[index] if index < len(reply.counts) else 0
            if index in self._further:
                self._further[index](ids[further : further + count])
            further += count

    # ------------------------------------------------------------ references and arrays

    def ref(self, thing: Named | Asset, field: str) -> types.Ref:
        """The Ref of a handle or a name."""
        if isinstance(thing, str) and thing:
            return types.Ref(name=thing)
        if isinstance(thing, Asset):
            thing = thing.root
        if isinstance(thing, Handle):
            return thing.ref(self)
        raise InvalidArgument(f"{field}: needs a handle or a name, not {thing!r}", field=field)

    def asset(self, data: NdArray) -> types.Array:
        """An array that stays: large ones travel once, by hash."""
        return self.scene.client.store.asset(data, self.sources)

    def note_decoding(self, digest: bytes) -> None:
        """Adds a decoding to the sources, if the digest names one."""
        known = self.scene.client.store.decodings
        if digest in known:
            self.sources.add_decoding(digest, known[digest])

    def edited(self, data: NdArray | GpuArray) -> types.Array:
        """An array that changes. An overlay is used more than once, an upload only once."""
        store = self.scene.client.store
        if isinstance(data, GpuArray):
            message, loan = store.lent(data)
            self._loans.append(loan)
            return message
        return store.edited(data) if self._publish else self.asset(data)

    @property
    def is_lent(self) -> bool:
        """True if the transaction names arrays on a GPU, which it keeps alive."""
        return bool(self._loans)

    def _add(self, target: Named | None, exist_ok: bool = True, update: bool = False) -> pb.Edit:
        if not self._open:
            raise FailedPrecondition("this transaction is over: open another with scene.edit()")
        edit = self.transaction.edits.add()
        edit.mode = pb.Edit.MODE_UPDATE if update else pb.Edit.MODE_UPSERT
        if not exist_ok:
            edit.mode = pb.Edit.MODE_CREATE
        if target is not None:
            try:
                edit.target.CopyFrom(self.ref(target, "name"))
            except BaseException:
                del self.transaction.edits[-1]
                raise
        return edit

    def _handle(self, kind: type[_H], target: Named | None) -> _H:
        """The handle of the edit just added."""
        if isinstance(target, Handle):
            if not isinstance(target, kind):
                raise InvalidArgument(f"{target!r} is not a {kind.kind}", field="name")
            return target
        handle = kind(self.scene, target or "")
        handle._edits, handle._index = self, len(self.transaction.edits) - 1
        self._made[handle._index] = handle
        return handle

    # ------------------------------------------------------------ entities

    def entity(
        self,
        name: Named | None = None,
        *,
        exist_ok: bool = True,
        **components: Unpack[patches.Components],
    ) -> Entity:
        """Creates or changes an entity: any combination of the Components.

        transform: 4x4 or hg.Pose, relative to the parent; or keys={seconds: pose}.
        parent, mesh, volume: handles or names. material: one for all parts, or materials=[...].
        camera: hg.Camera. light: hg.Light, given off by its mesh. portal: hg.Portal, a window.
        label: "auto", a number, or 0 for none; category, group, part belong to it.
        visible=False removes it from every ray and label; visibility=hg.Visibility(camera=False)
        keeps its light. attributes={str: str} travel to the labels. teleport: the pose is a jump.
        light_group: the name that all its light counts under in planes "beauty:NAME".
        shadow_catcher=True: it shows in the plane "shadow_catcher" alone.
        static=True: it does not move, and is traced faster; moving it rebuilds all that is static.
        """
        message = patches.entity_message(self, patches.labelled(components))
        self._add(name, exist_ok).entity.CopyFrom(message)
        return self._handle(Entity, name)

    def update(self, target: Named, **components: Unpack[patches.Components]) -> Entity:
        """Changes an entity that exists; NotFound lists the nearest names."""
        message = patches.entity_message(self, components)
        self._add(target, update=True).entity.CopyFrom(message)
        return target if isinstance(target, Entity) else self._handle(Entity, target)

    def instances(
        self, name: str, *, transforms: Any, **components: Unpack[patches.Components]
    ) -> Group:
        """Creates entities "<name>/0" .. that share everything but the pose.

        transforms: (N, 4, 4), sent as one packed message; see set_transforms.
        """
        prototype = patches.entity_message(self, patches.labelled(components))
        matrices = packed_matrices(transforms)
        action = self._add(name).instances
        action.prototype.CopyFrom(prototype)
        action.matrices.CopyFrom(self.edited(matrices))
        index = len(self.transaction.edits) - 1
        made = [Entity(self.scene, f"{name}/{i}") for i in range(len(matrices))]
        for entity in made:
            entity._edits, entity._index = self, BY_NAME
        self._further[index] = functools.partial(give_ids, made)
        return Group(made, name)

    def set_transforms(self, entities: Any, transforms: Any, *, teleport: bool = False) -> None:
        """Sets the poses of N entities: a group, an asset, or a sequence; (N, 4, 4).

        An array on a GPU (PyTorch, CuPy, JAX) goes to the daemon's GPU without this process's host.
        """
        made_here, ids, matrices = _poses.placed(self, entities, transforms)
        if made_here:
            for handle, matrix in zip(made_here, matrices):
                self.update(handle, transform=matrix, teleport=teleport)
            return
        action = self._add(None).poses
        action.ids.CopyFrom(ids)
        action.matrices.CopyFrom(self.edited(matrices))
        action.teleport = teleport

    # ------------------------------------------------------------ shared objects

    def mesh(
        self,
        name: Named | None = None,
        *,
        exist_ok: bool = True,
        **geometry: Unpack[patches.Geometry],
    ) -> Mesh:
        """Creates a mesh, of triangles (indices) or curves (curves, radii), or changes one.

        positions: (V, 3) metres, or (K, V, 3) at times. indices: (F, 3), counter-clockwise seen
        from outside. normals: (V, 3); None: flat. uvs: (V, 2). parts: (F,) from 0. curves: (S,)
        points of each strand, radii: (V,) metres; of splines by hg.smooth_curves(). keypoints:
        {name: (3,)}. New positions alone keep the topology, so that flow and labels follow it.
        """
        message = patches.mesh_message(self, geometry)
        self._add(name, exist_ok).mesh.CopyFrom(message)
        return self._handle(Mesh, name)

    def material(
        self,
        name: Named | None = None,
        *,
        exist_ok: bool = True,
        **parameters: Unpack[patches.Parameters],
    ) -> Material:
        """Creates or changes a material; parameters are constants, textures or hg.Tex."""
        message = patches.material_message(self, parameters)
        self._add(name, exist_ok).material.CopyFrom(message)
        return self._handle(Material, name)

    def texture(
        self,
        name: Named | None = None,
        image: Any = None,
        *,
        layer: str = "",
        encoding: str | None = None,
        wrap: str | tuple[str, str] | None = None,
        filter: str | None = None,
        exist_ok: bool = True,
    ) -> Texture:
        """Creates or changes a texture.

        image: a file's path (decoded by the daemon; .ies: a luminaire's candela), an array (H, W)
        or (H, W, C), row 0 at the top, or a PIL image; u8 and u16 are normalised, f16 and f32 taken
        as they are. A PIL image of another mode than grey or RGB, with alpha or not, is converted.
        A hg.FileWarning names assumptions about a file, and changes to it.
        layer: of a file with several: "diffuse" of an EXR's channels diffuse.R, diffuse.G,
        diffuse.B, the name of a part, or of a channel ("Z").
        encoding: "srgb" or "linear"; default: u8 is sRGB. wrap: "repeat", "clamp" or "mirror", or
        one for each axis. filter: "linear" or "nearest".
        """
        sampler = images.Sampler(encoding, wrap, filter)
        out = images.texture_message(self, image, sampler, layer)
        self._add(name, exist_ok).texture.CopyFrom(out)
        return self._handle(Texture, name)

    def volume(
        self,
        name: Named | None = None,
        *,
        exist_ok: bool = True,
        **medium: Unpack[volumes.Medium],
    ) -> Volume:
        """Creates a volume (density), or changes one: a medium that absorbs, scatters and glows.

        density, temperature: (X, Y, Z) arrays, >= 0; color: (X, Y, Z, 3) in [0, 1]. They fill one
        box, which begins at origin (3,) metres and has the density's voxels of voxel_size metres.
        """
        message = volumes.volume_message(self, medium)
        self._add(name, exist_ok).volume.CopyFrom(message)
        return self._handle(Volume, name)

    # ------------------------------------------------------------ files

    def import_file(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        name: str | None = None,
        count: int = 1,
        up: str = "",
        units: float = 0.0,
        variant: str = "",
        surface: bool = False,
        server_path: str = "",
        folders: Sequence[str | os.PathLike[str]] = (),
        strict: bool = False,
        **placement: Unpack[assets.Placement],
    ) -> Asset:
        """Decodes a model (glTF, FBX, OBJ, .. : docs/formats.md) and places it `count` times.

        up ("x", "y", "z") and units (metres per unit) serve formats that name none, and override a
        file's own; glTF refuses them. variant: of a glTF with KHR_materials_variants, the name of
        the one to show instead of the default; NotFound lists the names. surface: of a volume file,
        its level sets as a mesh, a part each, not one as fog; refused without any. server_path: a
        file under the daemon's asset root. Roots are `name`, or "<name>/0" .. if count > 1.

        Textures and other companions are read from beneath the model's folder, and beneath
        `folders`: at the path in the model, else a file of the same name. Without one the
        model loads, and asset.warnings names it; strict=True refuses the model (NotFound).
        """
        count = whole_of(count, "count")
        source = assets.Source(
            path, server_path, up, units, folders, strict, variant=variant, surface=surface
        )
        asset = assets.decode(self.scene, source, name)
        for i in range(count):
            root = asset.name if count == 1 else f"{asset.name}/{i}"
            self._instantiate(asset, root, placement)
        return asset

    def instance(
        self, asset: Asset, name: str | None = None, **placement: Unpack[assets.Placement]
    ) -> Entity:
        """Places an asset again, without decoding it again.

        materials={"Leather": other} overrides for this copy only, by the names in the file.
        """
        root = name or f"{asset.name}/{len(asset.roots)}"
        return self._instantiate(asset, root, placement)

    def _instantiate(self, asset: Asset, name: str, placement: assets.Placement) -> Entity:
        message = assets.instantiate_message(self, asset, placement)
        self._add(name, exist_ok=False).instantiate.CopyFrom(message)
        root = self._handle(Entity, name)
        self._further[root._index] = asset.place(root)
        return root

    # ------------------------------------------------------------ the whole scene

    def remove(self, things: Any, *, cascade: bool = False) -> None:
        """Removes objects. FailedPrecondition lists who still uses one; `cascade` removes an
        entity's children too and unbinds references to it."""
        for thing in flatten(things, "things"):
            self._add(thing).remove.cascade = cascade

    def prune(self) -> None:
        """Removes every mesh, material, texture and volume that nothing refers to."""
        self._add(None).prune.SetInParent()

    def advance(self, dt: float) -> None:
        """Makes the present poses the keys at the old time and moves the scene's time by dt
        seconds; what follows is the state at the new time. Flow is backward from then on."""
        self._add(None).advance.dt = number_of(dt, "dt")

    def categories(self, *names: str) -> None:
        """Gives classes ids in this order, the same in every scene; known classes keep theirs."""
        self._add(None).settings.categories.extend(text_of(n, "categories") for n in names)

    def time(self, t: float) -> None:
        """Sets the scene's time, seconds."""
        self._add(None).settings.time = number_of(t, "time")

    def sample_studio(self, *, floor: float = 40.0) -> Entity:
        """The bundled dome, and a floor of `floor` metres called "floor" at z = 0; the floor."""
        self.dome(studio.dome())
        return studio.add_floor(self, floor)
