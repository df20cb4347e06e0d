"""Writes a world to a GLB file: nodes with their meshes, lights and cameras. Source: glTF 2.0,
3.5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire._proto import scene_pb2 as pb
from ..._wire.arrays import NdArray
from ...values.rotations import quaternions_of
from ..emission import Emission, emission_of
from ..geometry import Geometries, Geometry
from ..motion import Poses, Track, mixed_at
from ..notes import note_rest
from ..world import Entity, World, key_of
from .document import Document
from .lights import Lights, camera_of
from .materials import Materials
from .meshes import Meshes
from .motion import Clip, weights_of
from .textures import Textures

# +Z up to glTF's +Y up, column by column.
_UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
_HIDDEN = "KHR_node_visibility"


def write(world: World, path: Path) -> None:
    """Writes the file; world.notes names features that it lacks."""
    writer = _Writer(world)
    writer.put()
    writer.document.write(path)


class _Writer:
    def __init__(self, world: World) -> None:
        self.world = world
        self.document = Document()
        self.poses = Poses(world)
        self.geometries = Geometries(world)
        textures = Textures(world, self.document)
        self.materials = Materials(world, self.document, textures)
        self.meshes = Meshes(self.document)
        self.lights = Lights(world, self.document)
        self.clip = Clip(world, self.document)
        self.nodes: dict[int, int] = {}  # by entity: the node whose children are its own
        self.top: list[int] = []
        self.skinned: list[Entity] = []

    def put(self) -> None:
        root = self.document.add("nodes", {"name": self.world.name or "scene", "matrix": _UP})
        for entity in self.world.entities.values():
            self._put(entity)
        for entity in self.skinned:
            self._put_skinned(entity)
        if self.top:
            self.document.json["nodes"][root]["children"] = self.top
        self.clip.write()
        self.document.json["scene"] = 0
        self.document.add("scenes", {"name": self.world.name or "scene", "nodes": [root]})
        if self.world.dome is not None:
            self.world.notes.add("dome", "glTF has none: it is left out")

    # ------------------------------------------------------------ nodes

    def _put(self, entity: Entity) -> None:
        message = entity.message
        if self.world.is_skin_alone(entity):
            self.skinned.append(entity)
            note_rest(self.world, entity, True)
            return
        index = self._place(entity)
        node = self.document.json["nodes"][index]
        extras = _extras(message)
        if extras:
            node["extras"] = extras
        below: dict[str, Any] | None = None
        if message.HasField("camera"):
            camera = camera_of(self.world, entity)
            if camera is not None:
                node["camera"] = self.document.add("cameras", camera)
        if message.HasField("light"):
            below = self.lights.put(node, entity, self.poses.world_now(entity.key))
        if entity.is_mesh and message.HasField("skin"):
            self.skinned.append(entity)
        elif entity.is_mesh:
            self._bind(entity, node, index)
        if below is not None:
            self._attach(index, self.document.add("nodes", below))
        is_seen = entity.is_mesh or below is not None
        note_rest(self.world, entity, is_seen)
        if message.HasField("portal"):
            self.world.notes.add(entity.title, "portals are left out")

    def _place(self, entity: Entity) -> int:
        """Adds a node, or two where the pose is sheared: its index, that of the inner one."""
        node: dict[str, Any] = {"name": entity.name} if entity.name else {}
        if entity.is_hidden:
            self._hide(node)
        track, index = self.poses.tracks[entity.key], self.document.add("nodes", node)
        if entity.parent is None:
            self.top.append(index)
        else:
            self._attach(self.nodes[entity.parent], index)
        inner = self._pose(node, entity, track)
        if inner is not None:
            outer, index = index, self.document.add("nodes", inner)
            self._attach(outer, index)
        elif track.moves:
            self.clip.put_pose(index, track)
        self.nodes[entity.key] = index
        return index

    def _pose(self, node: dict[str, Any], entity: Entity, track: Track) -> dict[str, Any] | None:
        """Puts the pose at this time. Returns the node to put below it, for a sheared one."""
        now = track.at(self.world.time)
        if track.is_sheared and not track.moves:
            outer, inner = unsheared(now)
            node.update(_trs(outer))
            return {"name": f"{entity.name}.turned", **_trs(inner)}
        if track.is_sheared:
            self.world.notes.add(entity.title, "the shear of a pose that moves is left out")
        node.update(_trs(_rigid(track, self.world.time) if track.is_sheared else now))
        return None

    def _attach(self, parent: int, child: int) -> None:
        self.document.json["nodes"][parent].setdefault("children", []).append(child)

    def _hide(self, node: dict[str, Any]) -> None:
        name = self.document.extension(_HIDDEN)
        node.setdefault("extensions", {})[name] = {"visible": False}
        self.world.notes.add(
            node.get("name", "an entity"), f"is hidden by {_HIDDEN}, which not every program reads"
        )

    # ------------------------------------------------------------ meshes

    def _bind(self, entity: Entity, node: dict[str, Any], index: int, skin: bool = False) -> None:
        key = key_of(entity.message.mesh)
        assert key is not None
        geometry = self.geometries[key]
        node["mesh"] = self.meshes.of(key, geometry, self._looks(entity, geometry), skin)
        if not len(geometry.morphs) and len(geometry.times) == 1:
            return
        times, weights = weights_of(self.world, entity, geometry)
        node["weights"] = mixed_at(times, weights, self.world.time).tolist()
        if len(times) > 1:
            self.clip.put_weights(index, times, weights)

    def _looks(self, entity: Entity, geometry: Geometry) -> list[int]:
        emission: Emission | None = None
        if entity.message.HasField("light"):
            emission = emission_of(self.world, entity, self.poses, self.geometries)
        thickness = float(np.ptp(geometry.keyed[0], axis=0).min())
        bound = [key_of(ref) for ref in entity.message.materials.parts] or [None]
        return [self.materials.of(key, emission, thickness) for key in bound]

    def _put_skinned(self, entity: Entity) -> None:
        """A node of its own: it follows the joints alone."""
        is_alone = entity.key not in self.nodes
        node: dict[str, Any] = {"name": entity.name if is_alone else f"{entity.name}.skin"}
        extras = _extras(entity.message)
        if extras and is_alone:
            node["extras"] = extras
        skin = entity.message.skin
        joints = [self.nodes[joint] for joint in map(key_of, skin.joints) if joint is not None]
        binds = np.asarray(self.world.array(skin.inverse_binds), dtype="<f4")
        found: dict[str, Any] = {"joints": joints}
        found["inverseBindMatrices"] = self.document.accessor(binds.transpose(0, 2, 1))
        node["skin"] = self.document.add("skins", found)
        if not self.world.shows(entity):
            self._hide(node)
        index = self.document.add("nodes", node)
        self.top.append(index)
        self._bind(entity, node, index, skin=True)


def unsheared(matrix: NdArray) -> tuple[NdArray, NdArray]:
    """(4, 4) of translation, rotation and scale, and a rotation, whose product it is."""
    u, sizes, v = np.linalg.svd(matrix[:3, :3])
    outer, inner = np.eye(4), np.eye(4)
    inner[:3, :3] = v * np.sign(np.linalg.det(v))
    outer[:3, :3] = u * sizes * np.sign(np.linalg.det(v))
    outer[:3, 3] = matrix[:3, 3]
    return outer, inner


def _rigid(track: Track, time: float) -> NdArray:
    """A pose without its shear."""
    scales = mixed_at(track.times, track.scales, time)
    pose = track.at(time)
    out = pose.copy()
    stretch = mixed_at(track.times, track.stretches, time)
    out[:3, :3] = pose[:3, :3] @ np.linalg.inv(stretch) * scales
    return out


def _trs(matrix: NdArray) -> dict[str, Any]:
    """Translation, rotation and scale of a pose, without default ones."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale = -scale
    w, x, y, z = quaternions_of(matrix[:3, :3] / scale)
    found = {"translation": matrix[:3, 3], "rotation": np.array([x, y, z, w]), "scale": scale}
    plain: Mapping[str, Any] = {"translation": 0, "rotation": (0, 0, 0, 1), "scale": 1}
    return {
        name: [float(x) for x in values]
        for name, values in found.items()
        if not np.array_equal(values, np.broadcast_to(plain[name], values.shape))
    }


def _extras(message: pb.Entity) -> dict[str, Any]:
    """Extras of a node: its labels, for programs that keep them."""
    label = message.label
    found: dict[str, Any] = {}
    if label.category:
        found["category"] = label.category
    if label.WhichOneof("instance") == "value":
        found["instance"] = label.value
    if label.part:
        found["part"] = label.part
    if message.light_group:
        found["light_group"] = message.light_group
    if message.attributes.values:
        found["attributes"] = dict(sorted(message.attributes.values.items()))
    return found
