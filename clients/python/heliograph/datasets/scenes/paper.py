"""PaperScene: what DOME, MESH and FAT have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...components import Camera
from ...pose import Pose
from ..randomizers.lighting import RandomDome
from .wares import add_wares

if TYPE_CHECKING:
    from ...edit import Edits
    from ...handles import Entity
    from ...scene import Scene
    from ..draw import Compose


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
