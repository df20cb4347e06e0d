"""A Model to edits."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import HeliographError, InvalidArgument
from ..scene import patches
from ..scene.handles import Entity, Material, Mesh, Texture
from ..values.checks import refuse_unknown
from ..values.components import Tex
from ..values.pose import matrix_of
from .asset import UsdAsset
from .model import Articulation, Image, Node, Pose, Sampled
from .robots import RobotBuilder, UsdRobot, components_of

if TYPE_CHECKING:
    from ..client.edit import Edits


class Builder:
    """Puts the entities of one placement; meshes, materials and textures with the first."""

    def __init__(
        self, edits: Edits, asset: UsdAsset, keypoints: Sequence[str] | None = None
    ) -> None:
        self.edits = edits
        self.asset = asset
        self.model = asset.model
        self.library = asset.library
        self.keypoints = keypoints
        self.components: Mapping[str, Any] = {}
        tops = {node.path.split("/")[1] for node in self.model.nodes}
        self.folder = "robots"  # that their links are beneath
        while self.folder in tops:
            self.folder += "'"
        self.articulated = {path: one for one in self.model.articulations for path in one.bodies}

    def build(self, components: patches.Components) -> UsdAsset:
        """keypoints: names of robots' joints, None for all."""
        refuse_unknown(components, patches.Components, "an entity")
        self._check_keypoints()
        self.components = components
        given: Any = {"label": "auto", **components}
        self.asset.root = self.edits.entity(self.asset.name, exist_ok=False, **given)
        for node in self.model.nodes:
            self._put(node)
        for node in self.model.nodes:
            if node.joints is not None:
                joints = [self.asset.entities[path] for path in node.joints[0]]
                self.edits.update(self.asset.entities[node.path], skin=(joints, node.joints[1]))
        self._put_dome(components)
        return self.asset

    # ------------------------------------------------------------ entities

    def _put(self, node: Node) -> None:
        parent, pose = self._place(node)
        given: dict[str, Any] = {"parent": parent, **node.rest}
        if node.mesh is not None:
            given["mesh"] = self._mesh(node.mesh)
            given["materials"] = [self._material(look) for look in node.looks]
        name = f"{self.asset.name}{node.path}"
        if node.transforms is not None:
            group = self.edits.instances(name, transforms=node.transforms, **given)
            self.asset.instances[node.path] = group
            return
        moves = isinstance(pose, Mapping)
        given["keys" if moves else "transform"] = pose
        entity = self.edits.entity(name, exist_ok=False, **given)
        self.asset.entities[node.path] = entity
        if "camera" in node.rest:
            self.asset.cameras[node.path] = entity
        if "light" in node.rest:
            self.asset.lights[node.path] = entity

    def _place(self, node: Node) -> tuple[Entity, Pose]:
        """Parent of a node's entity, and its pose there: bodies are beneath the links of their
        robot."""
        found = self.articulated.get(node.path)
        if found is None:
            return self._entity(node.parent), node.pose
        if found.path not in self.asset.robots:
            self._put_robot(found)
        link, pose = found.bodies[node.path]
        return self.asset.robots[found.path].links[link], pose

    def _entity(self, path: str | None) -> Entity:
        return self.asset.root if path is None else self.asset.entities[path]

    def _put_robot(self, found: Articulation) -> None:
        name = f"{self.asset.name}/{self.folder}{found.path}"
        robot = UsdRobot(self.edits.scene, name, found, self.library.robots.get(found.path))
        wanted = self.keypoints
        if wanted is not None:
            wanted = [joint.name for joint in found.robot.joints if joint.name in wanted]
        given: Any = components_of(self.components, found, self._entity(found.above))
        RobotBuilder(self.edits, robot).build(wanted, given)
        self.asset.robots[found.path] = robot
        self.library.robots[found.path] = robot.library

    def _check_keypoints(self) -> None:
        have = [joint.name for one in self.model.articulations for joint in one.robot.joints]
        for name in self.keypoints or ():
            if name not in have:
                listed = ", ".join(have) or "none"
                raise InvalidArgument(
                    f"keypoints: there is no joint {name!r}; the stage has {listed}",
                    field="keypoints",
                )

    def _put_dome(self, components: Mapping[str, Any]) -> None:
        """The scene's: the last placement's, turned as its root is in its parent."""
        dome = self.model.dome
        if dome is None:
            return
        at = components.get("transform")
        u, _, v = np.linalg.svd(np.eye(3) if at is None else matrix_of(at)[:3, :3])
        options = {**dome.options, "rotation": u @ v @ dome.rotation}
        if dome.image is None:
            self.edits.dome(None)
            self.edits.dome(**options)
        else:
            self.edits.dome(dome.image, **options)

    # ------------------------------------------------------------ what is shared

    def _mesh(self, key: str) -> Mesh:
        """Prims with equal arrays share one, as 64 copies of a robot do."""
        if key not in self.library.meshes:
            geometry = self.model.meshes[key]
            first = self.library.alike.setdefault(_digest(geometry), key)
            if first == key:
                name = f"{self.asset.name}{key}"
                made = self.edits.mesh(name, exist_ok=False, **geometry)
            else:
                made = self.library.meshes[first]
            self.library.meshes[key] = made
        return self.library.meshes[key]

    def _material(self, key: str) -> Material:
        if key not in self.library.materials:
            name = f"{self.asset.name}/{key.lstrip('/')}"
            look = self.model.looks[key]
            given: Any = {k: self._parameter(k, v) for k, v in look.parameters.items()}
            given = {k: v for k, v in given.items() if v is not None}
            self.library.materials[key] = self.edits.material(name, exist_ok=False, **given)
        return self.library.materials[key]

    def _parameter(self, name: str, value: Any) -> Any:
        """None: it is left to its default, as the image cannot be read."""
        if not isinstance(value, Sampled):
            return value
        texture = self._texture(value.texture)
        if texture is None:
            return value.fallback
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(Tex)}
        return Tex(**{**fields, "texture": texture})

    def _texture(self, image: Image) -> Texture | None:
        if image not in self.library.textures:
            name = f"{self.asset.name}/textures/{len(self.library.textures)}/{image.file.name}"
            try:
                found = self.edits.texture(
                    name, image.file, encoding=image.encoding, wrap=image.wrap, exist_ok=False
                )
            except HeliographError as error:
                self.model.notes.add(image.file.name, f"a texture cannot be decoded: {error}")
                self.library.textures[image] = None
            else:
                self.library.textures[image] = found
        return self.library.textures[image]


def _digest(geometry: Mapping[str, Any]) -> bytes:
    """SHA-256 of the arrays of a mesh."""
    out = hashlib.sha256()
    for name, value in sorted(geometry.items()):
        array = np.ascontiguousarray(value)
        out.update(f"{name} {array.dtype} {array.shape}".encode())
        out.update(repr(value).encode() if array.dtype.hasobject else array.tobytes())
    return out.digest()
