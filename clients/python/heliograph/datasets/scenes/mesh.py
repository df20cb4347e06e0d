"""MESH: about a thousand meshes that move, under lights behind the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...values.pose import look_at
from ..draw import Compose
from ..randomizers.lighting import RandomLights
from ..randomizers.looks import RandomMaterials
from ..randomizers.moving import RandomMotion
from ..randomizers.props import random_shape
from ..randomizers.ranges import LogUniform
from ..randomizers.swarm import Swarm
from .paper import PaperScene

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ...client.scene import Scene
    from ...scene.handles import Entity


@dataclass(frozen=True)
class MeshScene(PaperScene):
    """MESH: about 1,000 meshes at random places, turned, sized and coloured at random, that move;
    2 to 6 lights behind the camera of random colour, temperature and intensity; backward flow.

    objects, shapes, materials: how many there are; every mesh is an instance of its category, the
    shape's number. depth: metres, (nearest, farthest) from the camera. size: metres, of the longest
    side. speed: metres per second; spin: radians per second; interval: seconds between two frames.
    lights: (least, most). ambient: radiance of the uniform dome.
    """

    objects: int = 1000
    roulette_depth: int = 1  # most of the light comes straight from the lights
    shapes: int = 60
    materials: int = 150
    depth: tuple[float, float] = (2.0, 12.0)
    size: tuple[float, float] = (0.15, 0.9)
    speed: tuple[float, float] = (0.0, 1.5)
    spin: tuple[float, float] = (0.0, 4.0)
    interval: float = 1 / 30
    lights: tuple[int, int] = (2, 6)
    ambient: float = 0.02

    def build(self, scene: Scene) -> tuple[Entity, Compose]:
        rng = np.random.default_rng(self.seed)
        with scene.edit() as edit:
            things = self._models(edit, rng) if self.models else self._shapes(edit, rng)
            materials = [
                edit.material(f"mesh/material/{i}", base_color=0.5) for i in range(self.materials)
            ]
            for i, thing in enumerate(things):
                if not self.models:
                    edit.update(thing, material=materials[i % len(materials)])
            edit.dome(None)
            edit.dome(color=self.ambient)
            camera = self._camera(edit, look_at((0, 0, 0), (1, 0, 0)))
        randomizer = Compose(
            Swarm(things, camera, depth=self.depth, size=LogUniform(*self.size)),
            RandomMaterials(materials),
            RandomLights(
                self.lights,
                distance=(0.5, 4.0),
                radius=(0.1, 0.6),
                power=LogUniform(150.0, 1500.0),
            ),
            RandomMotion(things, speed=self.speed, spin=self.spin, interval=self.interval),
        )
        return camera, randomizer

    def _shapes(self, edit: Edits, rng: np.random.Generator) -> list[Entity]:
        meshes = [edit.mesh(f"mesh/shape/{i}", **random_shape(rng, 32)) for i in range(self.shapes)]
        return [
            edit.entity(
                f"mesh/{i}", mesh=meshes[i % len(meshes)], category=f"shape{i % len(meshes)}"
            )
            for i in range(self.objects)
        ]

    def _models(self, edit: Edits, rng: np.random.Generator) -> Any:
        return self._things(edit)
