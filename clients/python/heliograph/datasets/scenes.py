"""The scenes of the NViSII paper (Morrical et al. 2021, section 4) as generators: DOME, MESH, FAT.

Each is a frozen dataclass, its settings, whose build(scene) makes the scene and gives the camera
and the randomizer for generate(). `heliograph dataset dome --count 6000 --out DIR` runs one.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import shapes
from ..components import Camera
from ..errors import InvalidArgument, Unimplemented
from ..pose import Pose, look_at
from .draw import Compose
from .flying import Distractors, add_distractors
from .inview import InView
from .lighting import RandomDome, RandomLights
from .looks import RandomMaterials, RandomTextures
from .moving import RandomMotion
from .patterns import bundled_textures
from .placing import InVolume
from .props import random_shape
from .ranges import LogUniform
from .settling import Settle
from .swarm import Swarm
from .viewpoints import LookAtJitter, Orbit
from .wares import add_wares

if TYPE_CHECKING:
    from ..edit import Edits
    from ..handles import Entity
    from ..scene import Scene


@dataclass(frozen=True)
class PaperScene:
    """What the three have in common.

    width, height: pixels; fov: radians along the width. seed: of what the scene is made of, not of
    the draws. models: files; a category each, by the file's name; default: bundled household goods.
    model_size: metres of their longest sides, 0: as they are. objects: how many, over all.
    domes: lat-long pictures, files or one folder; default: hd.bundled_domes().
    """

    width: int = 640
    height: int = 480
    fov: float = 1.05
    seed: int = 0
    models: Sequence[str] = ()
    model_size: float = 0.2
    objects: int = 12
    domes: Sequence[str] = ()

    def build(self, scene: Scene) -> tuple[Entity, Compose]:
        """Makes the scene; its camera, and what randomizes it."""
        raise NotImplementedError

    def _camera(self, edit: Edits, pose: Any) -> Entity:
        lens = Camera.from_fov(self.fov, self.width, self.height)
        return edit.entity("camera", camera=lens, transform=pose)

    def _things(self, edit: Edits) -> Any:
        if not self.models:
            return add_wares(edit, self.objects, seed=self.seed)
        things: list[Entity] = []
        for i, path in enumerate(self.models):
            count = len(range(i, self.objects, len(self.models)))
            if count == 0:
                continue
            stem = Path(path).stem
            asset = edit.import_file(path, category=stem, count=count)
            if self.model_size > 0 and asset.bounds is not None:
                size = float(np.ptp(asset.bounds, axis=0).max())
                for root in asset.roots:
                    edit.update(root, transform=Pose(scale=self.model_size / size))
            things.extend(asset.roots)
        return things

    def _domes(self, **options: Any) -> RandomDome:
        images = self.domes[0] if len(self.domes) == 1 else self.domes
        return RandomDome(images or None, **options)


@dataclass(frozen=True)
class DomeScene(PaperScene):
    """DOME, domain randomisation: objects float about under HDR domes among flying distractors.

    box: metres, the side of the cube in which objects are. distance: of the camera from its middle.
    distractors: (least, most); distractor_size: metres. rest as of PaperScene.
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


@dataclass(frozen=True)
class MeshScene(PaperScene):
    """MESH: about 1,000 meshes at random places, turned, sized and coloured at random, that move;
    2 to 6 lights behind the camera of random colour, temperature and intensity; backward flow.

    objects, shapes, materials: how many there are; every mesh is an instance of its category, the
    shape's number. depth: metres, (nearest, farthest) from the camera. size: metres, of the longest
    side. speed: metres a second; spin: radians a second; interval: seconds between two frames.
    lights: (least, most). ambient: radiance of the uniform dome. Domes are not used.
    """

    objects: int = 1000
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


@dataclass(frozen=True)
class FatScene(PaperScene):
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


SCENES: dict[str, type[PaperScene]] = {"dome": DomeScene, "mesh": MeshScene, "fat": FatScene}


def make_scene(name: str, **settings: Any) -> PaperScene:
    """The scene "dome", "mesh" or "fat" with some of its settings."""
    if name not in SCENES:
        raise InvalidArgument(f"scene: one of {', '.join(SCENES)}, not {name!r}", field="scene")
    known = {field.name: field for field in dataclasses.fields(SCENES[name])}
    for key, value in settings.items():
        if key not in known:
            raise InvalidArgument(
                f"{key}: {name} has no such setting; it has {', '.join(known)}", field=key
            )
        default = known[key].default
        if isinstance(default, (tuple, str)) != isinstance(value, (list, tuple, str)):
            raise InvalidArgument(f"{key}: needs a value like {default!r}", field=key)
    given: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value for key, value in settings.items()
    }
    return SCENES[name](**given)


def read_settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The settings in a TOML file; files in it are relative to it."""
    try:
        import tomllib  # type: ignore[import-not-found,unused-ignore]  # from Python 3.11 on
    except ImportError:
        raise Unimplemented(
            "settings in TOML need Python 3.11 or newer: give them to the class instead"
        ) from None
    path = Path(path)
    try:
        settings = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError as error:
        raise InvalidArgument(f"{path}: {error}", field="config") from None
    for key in ("models", "domes"):
        if key in settings:
            settings[key] = [str(path.parent / name) for name in settings[key]]
    return settings


def settings_text(scene: PaperScene) -> str:
    """All settings as TOML."""
    lines = []
    for field in dataclasses.fields(scene):
        value = getattr(scene, field.name)
        shown = list(value) if isinstance(value, tuple) else value
        lines.append(f"{field.name} = {str(shown).replace(chr(39), chr(34))}")
    return "\n".join(lines) + "\n"
