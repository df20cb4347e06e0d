"""DOME: objects under HDR domes among flying distractors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...values.pose import look_at
from ..draw import Compose
from ..randomizers.flying import Distractors, add_distractors
from ..randomizers.placing import InVolume
from ..randomizers.ranges import LogUniform
from ..randomizers.viewpoints import LookAtJitter, Orbit
from .paper import DomedScene

if TYPE_CHECKING:
    from ...client.scene import Scene
    from ...scene.handles import Entity


@dataclass(frozen=True)
class DomeScene(DomedScene):
    """DOME, domain randomisation: objects float about under HDR domes among flying distractors.

    box: metres, the side of the cube in which objects are. distance: of the camera from its middle.
    distractors: (least, most); distractor_size: metres. rest as of DomedScene.
    """

    box: float = 0.5
    distance: tuple[float, float] = (0.5, 1.1)
    distractors: tuple[int, int] = (5, 25)
    distractor_size: tuple[float, float] = (0.05, 0.25)

    def build(self, scene: Scene) -> tuple[Entity, Compose]:
        with scene.edit() as edit:
            things = self._things(edit)
            flying = add_distractors(edit, self.distractors[1], seed=self.seed)
            camera = self._camera(edit, look_at((1, 0, 0), (0, 0, 0)))
        half = 0.5 * self.box
        randomizer = Compose(
            InVolume(things, ((-half,) * 3, (half,) * 3)),
            Orbit(
                camera,
                (0.0, 0.0, 0.0),
                distance=self.distance,
                elevation=(-0.9, 1.3),
            ),
            LookAtJitter(camera, (0.0, 0.0, 0.0), offset=0.3 * self.box, roll=(-0.6, 0.6)),
            Distractors(
                flying,
                (0.0, 0.0, 0.0),
                count=self.distractors,
                radius=(0.1 * self.box, self.distance[1]),
                size=LogUniform(*self.distractor_size),
                clear_of=things,
            ),
            self._domes(),
        )
        return camera, randomizer
