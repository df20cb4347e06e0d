"""PaperScene: common base of DOME, MESH and FAT."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidArgument
from ...values.checks import whole_of
from ...values.components import Camera
from ...values.pose import Pose
from ..randomizers import ranges
from ..randomizers.lighting import RandomDome
from .wares import add_wares

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ...client.scene import Scene
    from ...scene.handles import Entity
    from ..draw import Compose


@dataclass(frozen=True)
class PaperScene:
    """Base of the three paper scenes. A setting of another kind than its default is refused.

    width, height: pixels; fov: radians along the width. seed: of the scene's content, not of the
    draws. models: files; a category each, by the file's name; default: bundled household goods.
    model_size: metres of their longest sides, 0: as they are. objects: their number, over all.
    roulette_depth: of Scene.render.
    """

    width: int = 640
    height: int = 480
    fov: float = 1.05
    seed: int = 0
    models: Sequence[str] = ()
    model_size: float = 0.2
    objects: int = 12
    roulette_depth: int = 2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = _checked(field.name, getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)

    @property
    def options(self) -> dict[str, Any]:
        """Options of Scene.render that suit the scene, for generate()."""
        return {"roulette_depth": self.roulette_depth}

    def build(self, scene: Scene) -> tuple[Entity, Compose]:
        """Makes the scene; returns its camera and its randomizer."""
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


@dataclass(frozen=True)
class DomedScene(PaperScene):
    """Base of the paper scenes under a dome: DOME and FAT.

    domes: lat-long pictures, files or one folder; default: hd.bundled_domes().
    """

    domes: Sequence[str] = ()

    def _domes(self) -> RandomDome:
        images = self.domes[0] if len(self.domes) == 1 else self.domes
        return RandomDome(images or None)


def _checked(name: str, value: Any, default: Any) -> Any:
    """A setting of the kind that its default has: paths, a pair of numbers, a count, a number."""
    if default == ():
        if isinstance(value, str) or not all(isinstance(path, (str, Path)) for path in value):
            raise InvalidArgument(f"{name}: needs a list of files, not {value!r}", field=name)
        return tuple(str(path) for path in value)
    if isinstance(default, tuple):
        if np.shape(value) != (2,):
            raise InvalidArgument(f"{name}: needs a value like {list(default)}", field=name)
        whole = all(isinstance(each, int) for each in default)
        pair = ranges.checked_pair(value, name, 0)
        return tuple(map(int, ranges.checked_count(pair, name))) if whole else pair
    if isinstance(default, int):
        return whole_of(value, name, 0 if name == "seed" else 1)
    return ranges.checked_number(value, name, 0)
