"""Writes a world to a USDZ file: prims with their meshes, lights and cameras. Needs pxr."""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, UsdGeom, UsdUtils

from ...errors import InvalidArgument
from ..emission import emission_of
from ..geometry import Geometries, Geometry
from ..lamps import Lamp
from ..motion import Poses
from ..notes import note_rest
from ..world import Entity, World, key_of
from .lights import put_camera, put_dome, put_light, put_portal
from .materials import Materials
from .meshes import Meshes, Morphs
from .skeletons import Skeletons
from .stage import TOP, Stage

SHAPES = "/Shapes"


def write(world: World, path: Path) -> None:
    """Writes the file; world.notes names features that it lacks."""
    with tempfile.TemporaryDirectory(prefix="heliograph-usdz-") as folder:
        writer = _Writer(world, Path(folder))
        writer.put()
        root = writer.stage.save()
        try:
            written = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(root)), str(path))
        except Tf.ErrorException as error:
            raise InvalidArgument(f"{path} cannot be written: {error}", field="path") from None
        if not written:
            raise InvalidArgument(f"{path} cannot be written by pxr", field="path")


class _Writer:
    def __init__(self, world: World, folder: Path) -> None:
        self.world = world
        self.stage = Stage(folder, world.name)
        self.poses = Poses(world)
        self.geometries = Geometries(world)
        self.materials = Materials(world, self.stage)
        self.meshes = Meshes(world, self.stage, self.materials)
        self.skeletons = Skeletons(world, self.stage, self.poses)
        self.paths: dict[int, str] = {}  # of entities
        self.shapes: dict[Any, str] = {}  # of meshes that several entities show
        self.emissions = {
            entity.key: emission_of(world, entity, self.poses, self.geometries)
            for entity in world.entities.values()
        }
        plain = (self._shape_key(entity) for entity in world.entities.values() if entity.is_mesh)
        self.uses = Counter(key for key in plain if key is not None)

    def put(self) -> None:
        UsdGeom.Scope.Define(self.stage.stage, self.stage.path(TOP, "Materials"))
        for entity in self.world.entities.values():
            self._put(entity)
        if self.world.dome is not None:
            put_dome(self.world, self.stage, self.world.dome)

    # ------------------------------------------------------------ prims

    def _put(self, entity: Entity) -> None:
        if self.world.is_skin_alone(entity):
            self._put_skinned(entity, entity.name)
            note_rest(self.world, entity, True)
            return
        parent = TOP if entity.parent is None else self.paths[entity.parent]
        path = self.paths[entity.key] = self.stage.path(parent, entity.name)
        prim = self._prim(entity, path)
        if entity.name and entity.name != prim.GetName():
            prim.SetDisplayName(entity.name)
        self.stage.pose(prim, self.poses.tracks[entity.key])
        if self.poses.tracks[entity.key].is_sheared and self.poses.tracks[entity.key].moves:
            self.world.notes.add(entity.title, "its keys have shear: matrices are mixed between")
        if entity.is_hidden:
            UsdGeom.Imageable(prim).MakeInvisible()
        _put_labels(prim, entity)
        note_rest(self.world, entity, True)

    def _prim(self, entity: Entity, path: str) -> Any:
        """Prim of an entity, of the kind of its first component; the others lie below it."""
        makers = self._makers(entity)
        prim = None
        while makers and prim is None:
            prim = makers.pop(0)[1](path)
        if prim is None:
            prim = UsdGeom.Xform.Define(self.stage.stage, path).GetPrim()
        for name, make in makers:
            make(self.stage.path(path, name))
        if entity.is_mesh and entity.message.HasField("skin"):
            self._put_skinned(entity, f"{entity.name}_skin")
        return prim

    def _makers(self, entity: Entity) -> list[tuple[str, Any]]:
        message, makers = entity.message, []
        if message.HasField("camera"):
            makers.append(("camera", lambda p: put_camera(self.world, self.stage, p, entity)))
        if message.HasField("light") and Lamp(message.light).shape != "mesh":
            pose = self.poses.world_now(entity.key)
            makers.append(("light", lambda p: put_light(self.world, self.stage, p, entity, pose)))
        if message.HasField("portal"):
            makers.append(("portal", lambda p: put_portal(self.stage, p, entity)))
        if entity.is_mesh and not message.HasField("skin"):
            if entity.children and not makers:  # surfaces have nothing below them
                makers.append(("", lambda p: UsdGeom.Xform.Define(self.stage.stage, p).GetPrim()))
            makers.append(("mesh", lambda p: self._put_mesh(p, entity)))
        return makers

    # ------------------------------------------------------------ meshes

    def _geometry(self, entity: Entity) -> Geometry:
        key = key_of(entity.message.mesh)
        assert key is not None
        return self.geometries[key]

    def _bound(self, entity: Entity) -> list[int | None]:
        return [key_of(ref) for ref in entity.message.materials.parts] or [None]

    def _shape_key(self, entity: Entity) -> Any:
        """Key that entities share if they show the same; None: no other entity shows it."""
        if entity.message.HasField("skin") or len(self._geometry(entity).morphs):
            return None
        bound = tuple(self._bound(entity))
        return key_of(entity.message.mesh), bound, self.emissions[entity.key]

    def _put_mesh(self, path: str, entity: Entity) -> Any:
        key = self._shape_key(entity)
        if key is None or self.uses[key] < 2:
            return self._define(path, entity).GetPrim()
        prim = UsdGeom.Xform.Define(self.stage.stage, path).GetPrim()
        if key not in self.shapes:
            self.shapes[key] = self._put_shape(entity)
        prim.GetReferences().AddInternalReference(self.shapes[key])
        prim.SetInstanceable(True)
        return prim

    def _put_shape(self, entity: Entity) -> str:
        """A mesh below a class, which is seen where it is referred to."""
        if not self.stage.stage.GetPrimAtPath(SHAPES):
            self.stage.stage.CreateClassPrim(SHAPES)
        path = self.stage.path(SHAPES, self._geometry(entity).name)
        UsdGeom.Xform.Define(self.stage.stage, path)
        self._define(f"{path}/mesh", entity)
        return path

    def _define(self, path: str, entity: Entity) -> Any:
        geometry, emission = self._geometry(entity), self.emissions[entity.key]
        return self.meshes.define(
            path, geometry, self._bound(entity), emission, self._morphs(entity, geometry)
        )

    def _morphs(self, entity: Entity, geometry: Geometry) -> Morphs:
        message = entity.message.morph_weights
        given = self.world.optional(message, "weights")
        if given is None or not len(geometry.morphs):
            return Morphs(np.zeros(1), np.zeros((1, len(geometry.morphs))))
        weights = np.atleast_2d(given)
        times = self.world.array(message.times) if len(weights) > 1 else np.zeros(1)
        return Morphs(np.asarray(times, dtype="f8"), weights)

    def _put_skinned(self, entity: Entity, name: str) -> None:
        """Beside all else, as it follows its joints alone."""
        path = self.stage.path(TOP, name)
        root = self.skeletons.root(path)
        if not self.world.shows(entity):
            UsdGeom.Imageable(root).MakeInvisible()
        _put_labels(root, entity)
        mesh = self._define(self.stage.path(path, "mesh"), entity)
        self.skeletons.bind(path, mesh, entity, self._geometry(entity))


def _put_labels(prim: Any, entity: Entity) -> None:
    """The category as UsdSemantics has it; attributes of the user's as userProperties."""
    message = entity.message
    if message.label.category:
        prim.AddAppliedSchema("SemanticsLabelsAPI:class")
        kind = Sdf.ValueTypeNames.TokenArray
        attribute = prim.CreateAttribute("semantics:labels:class", kind, False)
        attribute.Set([message.label.category])
    given = dict(message.attributes.values)
    if message.label.WhichOneof("instance") == "value":
        given["instance"] = str(message.label.value)
    if message.light_group:
        given["light_group"] = message.light_group
    for name, value in sorted(given.items()):
        name = f"userProperties:{Tf.MakeValidIdentifier(name)}"
        prim.CreateAttribute(name, Sdf.ValueTypeNames.String).Set(value)
