"""FAT: objects that fall onto a textured plane under an HDR dome."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...values import shapes
from ...values.pose import look_at
from ..draw import Compose
from ..randomizers.inview import InView
from ..randomizers.looks import RandomMaterials, RandomTextures
from ..randomizers.patterns import bundled_textures
from ..randomizers.placing import InVolume
from ..randomizers.ranges import LogUniform
from ..randomizers.settling import Settle
from ..randomizers.viewpoints import Orbit
from .paper import DomedScene

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ...client.scene import Scene
    from ...scene.handles import Entity


@dataclass(frozen=True)
class FatScene(DomedScene):
    """FAT: objects fall onto a textured plane under an HDR dome, by PyBullet, and are seen after
    some seconds, in the air or at rest.

    box: metres, the side of the box that they fall from; fall: metres, its lower and upper end.
    seconds: that they fall. distance: of the camera from the middle of the things. visible: how
    many of them at least are seen by a tenth. floors: how many of the bundled textures there are.
    """

    box: float = 0.5
    fall: tuple[float, float] = (0.15, 0.9)
    seconds: tuple[float, float] = (0.2, 1.2)
    distance: tuple[float, float] = (0.6, 1.3)
    visible: int = 4
    floors: int = 27

    def build(self, scene: Scene) -> tuple[Entity, Compose]:
        with scene.edit() as edit:
            things = self._things(edit)
            textures = [
                edit.texture(f"floor/texture/{i}", picture())
                for i, picture in enumerate(bundled_textures()[: self.floors])
            ]
            floor = self._floor(edit, textures[0])
            camera = self._camera(edit, look_at((1, 0, 0.6), (0, 0, 0)))
        half = 0.5 * self.box
        low, high = self.fall
        randomizer = Compose(
            InVolume(things, ((-half, -half, low), (half, half, high)), avoid=floor),
            Settle(things, on=floor, seconds=self.seconds, velocity=(0, 0.3), spin=(0, 4)),
            RandomTextures(scene["floor/material"], textures, scale=LogUniform(4.0, 30.0)),
            RandomMaterials(
                scene["floor/material"], base_color=None, metallic=0.0, roughness=(0.15, 0.9)
            ),
            InView(
                Orbit(camera, things, distance=self.distance, elevation=(0.25, 1.3)),
                things,
                least=min(self.visible, self.objects),
            ),
            self._domes(),
        )
        return camera, randomizer

    def _floor(self, edit: Edits, texture: Any) -> Entity:
        mesh = edit.mesh("floor/mesh", **shapes.plane(12.0))
        material = edit.material("floor/material", base_color=texture)
        return edit.entity("floor", mesh=mesh, material=material, label=0)
