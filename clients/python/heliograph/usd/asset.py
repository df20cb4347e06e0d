"""USD stages in scenes. Made by edit.import_usd(); docs/usd.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..scene.handles import Entity, Group, Material, Mesh, Texture

if TYPE_CHECKING:
    from ..client.scene import Scene
    from ..robots._library import Library as RobotLibrary
    from .model import Image, Model
    from .robots import UsdRobot


@dataclass
class Library:
    """State that the placements of one stage share."""

    meshes: dict[str, Mesh] = field(default_factory=dict)
    alike: dict[bytes, str] = field(default_factory=dict)  # first mesh by the SHA-256 of its arrays
    materials: dict[str, Material] = field(default_factory=dict)
    textures: dict[Image, Texture | None] = field(default_factory=dict)  # None: not readable
    robots: dict[str, RobotLibrary] = field(default_factory=dict)


class UsdAsset:
    """A USD stage in a scene.

    root: the entity with the pose of all of it, metres and +Z up. entities: {prim path: Entity} of
    every transformable prim. instances: {prim path: Group} of point instancers' prototypes.
    robots: bodies that joints connect, by the path of their articulation.
    meshes, materials: by prim path. cameras, lights: the entities that have one, by prim path.
    metres_per_unit, up: of the file. warnings: prims left out, or read otherwise.
    """

    def __init__(self, scene: Scene, name: str, model: Model, library: Library | None) -> None:
        self.scene = scene
        self.name = name
        self.model = model
        self.library = library or Library()
        self.metres_per_unit = model.metres_per_unit
        self.up = model.up
        self.entities: dict[str, Entity] = {}
        self.instances: dict[str, Group] = {}
        self.cameras: dict[str, Entity] = {}
        self.lights: dict[str, Entity] = {}
        self.robots: dict[str, UsdRobot] = {}
        self.root: Entity

    @property
    def meshes(self) -> Mapping[str, Mesh]:
        return self.library.meshes

    @property
    def materials(self) -> Mapping[str, Material]:
        return self.library.materials

    @property
    def warnings(self) -> list[str]:
        return self.model.notes.texts()

    def __repr__(self) -> str:
        return f"<UsdAsset {self.name!r}, {len(self.entities)} entities>"
