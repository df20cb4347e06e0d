"""Meshes and materials that the robots of one file share. Used by building.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..image.tonemap import decode_srgb
from ..scene import assets, patches
from ..scene.handles import Asset, Material, Mesh, Texture
from ..values import shapes
from ._notes import FAULTS
from .description import Look, Visual

if TYPE_CHECKING:
    from ..client.edit import Edits

_Made = TypeVar("_Made", Asset, Texture)


class Library:
    """Meshes and materials of a robot, each made once. roots: folders whose files may be read.
    warnings: about files that could not be read, and of files themselves."""

    def __init__(self, roots: Sequence[Path]) -> None:
        self.roots = roots
        self.assets: dict[Path, Asset] = {}
        self.meshes: dict[tuple[str, tuple[float, ...]], Mesh] = {}
        self.materials: dict[Look, Material] = {}
        self.keypoints: dict[str, Mesh] = {}
        self.warnings: list[str] = []
        self._names: set[str] = set()  # of materials
        self._failed: set[Path] = set()

    def asset(self, edits: Edits, file: Path, name: str, strict: bool) -> Asset | None:
        """A mesh file, decoded once; None: it cannot be."""
        if file not in self.assets:
            source = self._source(file, strict)
            asset = self._made(file, strict, lambda: assets.decode(edits.scene, source, name))
            if asset is None:
                return None
            self.warnings.extend(f"{file.name}: {text}" for text in asset.warnings)
            self.assets[file] = asset
        return self.assets[file]

    def mesh(self, edits: Edits, visual: Visual, name: str) -> Mesh:
        key = visual.shape, visual.size
        if key not in self.meshes:
            geometry = _shape(*key)
            self.meshes[key] = edits.mesh(f"{name}/mesh", exist_ok=False, **geometry)
        return self.meshes[key]

    def material(self, edits: Edits, look: Look, prefix: str, strict: bool) -> Material:
        """Material of a look, called "<prefix>/material/<its name>"; made once."""
        if look in self.materials:
            return self.materials[look]
        given: Any = {}
        if look.color is not None:
            *rgb, alpha = look.color
            given["base_color"] = decode_srgb(np.array(rgb))
            if alpha < 1:
                given.update(alpha=alpha, alpha_mode="blend")
        name = self._free(f"{prefix}/material/{look.name or len(self.materials)}")
        file = look.texture
        if file is not None:
            texture = self._made(file, strict, lambda: edits.texture(f"{name}/texture", file))
            if texture is not None:
                given["base_color"] = texture
        self.materials[look] = edits.material(name, exist_ok=False, **given)
        return self.materials[look]

    def _free(self, name: str) -> str:
        if name in self._names:
            name = f"{name}_{len(self.materials)}"
        self._names.add(name)
        return name

    def _source(self, file: Path, strict: bool) -> assets.Source:
        """COLLADA's numbers are in the link's frame whatever its up_axis, as RViz has it."""
        up = "z" if file.suffix.lower() == ".dae" else ""
        return assets.Source(file, up=up, folders=self.roots, strict=strict)

    def _made(self, file: Path, strict: bool, make: Callable[[], _Made]) -> _Made | None:
        """Calls make() for a file, which is tried once; None: the file is faulty. strict: raises
        instead."""
        if file in self._failed and not strict:
            return None
        try:
            return make()
        except FAULTS as error:
            if strict:
                raise
            self._failed.add(file)
            self.warnings.append(f"{file.name} is left out: {error}")
            return None


def _shape(shape: str, size: tuple[float, ...]) -> patches.Geometry:
    if shape == "box":
        cube = shapes.cube()
        return {**cube, "positions": np.asarray(cube["positions"]) * size}
    if shape == "cylinder":
        return shapes.cylinder(size[0], size[1])
    if shape == "capsule":
        return shapes.capsule(size[0], size[1])
    return shapes.sphere(size[0])
