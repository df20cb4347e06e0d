"""Meshes of glTF: one for each mesh with its materials. Source: glTF 2.0, 3.7.2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ..geometry import Geometry
from .document import INDICES, VERTICES, Document

_SMALL = 0xFFFF  # vertices that 16 bits can index, without the last one, which is reserved


@dataclass(frozen=True)
class Arrays:
    """Accessors that the primitives of a mesh share, as indices."""

    attributes: dict[str, int]
    targets: list[dict[str, int]]


class Meshes:
    """Puts meshes into a document; vertices and triangles of each once."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self._arrays: dict[tuple[int, bool], Arrays] = {}
        self._parts: dict[int, list[tuple[int, int]]] = {}
        self._made: dict[Any, int] = {}

    def of(self, key: int, geometry: Geometry, materials: list[int], skinned: bool) -> int:
        """The index of a mesh whose parts have these materials; the last one serves the rest."""
        known = key, tuple(materials), skinned
        if known not in self._made:
            self._made[known] = self._make(key, geometry, materials, skinned)
        return self._made[known]

    def _make(self, key: int, geometry: Geometry, materials: list[int], skinned: bool) -> int:
        if (key, skinned) not in self._arrays:
            self._arrays[key, skinned] = self._put(key, geometry, skinned)
        if key not in self._parts:
            self._parts[key] = self._put_parts(geometry)
        arrays, primitives = self._arrays[key, skinned], []
        for part, indices in self._parts[key]:
            primitive: dict[str, Any] = {"attributes": arrays.attributes, "indices": indices}
            primitive["material"] = materials[min(part, len(materials) - 1)]
            if arrays.targets:
                primitive["targets"] = arrays.targets
            if geometry.part_name(part):
                primitive["extras"] = {"part": geometry.part_name(part)}
            primitives.append(primitive)
        return self.document.add("meshes", {"name": geometry.name, "primitives": primitives})

    def _put(self, key: int, geometry: Geometry, skinned: bool) -> Arrays:
        if (key, not skinned) in self._arrays:
            found = self._arrays[key, not skinned]
            attributes = {k: v for k, v in found.attributes.items() if k[:6] not in _SKIN}
            targets = found.targets
        else:
            attributes, targets = self._shape(geometry), self._targets(geometry)
        if skinned and geometry.influences is not None:
            joints, weights = geometry.influences
            attributes["JOINTS_0"] = self.document.accessor(joints, VERTICES)
            attributes["WEIGHTS_0"] = self.document.accessor(weights, VERTICES)
        return Arrays(attributes, targets)

    def _shape(self, geometry: Geometry) -> dict[str, int]:
        positions = self.document.accessor(geometry.keyed[0], VERTICES, box=True)
        found: dict[str, int] = {"POSITION": positions}
        arrays: dict[str, NdArray | None] = {"COLOR_0": _clipped(geometry)}
        if geometry.keyed_normals is not None:
            arrays["NORMAL"] = geometry.keyed_normals[0]
            arrays["TANGENT"] = geometry.tangents
        for place, uvs in enumerate(geometry.uvs):
            arrays[f"TEXCOORD_{place}"] = np.column_stack([uvs[:, 0], 1 - uvs[:, 1]])
        for name, array in arrays.items():
            if array is not None:
                found[name] = self.document.accessor(array.astype("<f4", copy=False), VERTICES)
        return found

    def _targets(self, geometry: Geometry) -> list[dict[str, int]]:
        """Morph targets, then the keys of vertices but for the first, as differences from it."""
        moved = [*geometry.morphs, *(geometry.keyed[1:] - geometry.keyed[0])]
        turned: list[NdArray] = []
        if geometry.keyed_normals is not None:
            own = geometry.morph_normals
            turned = [*(np.zeros_like(geometry.morphs) if own is None else own)]
            turned += [*(geometry.keyed_normals[1:] - geometry.keyed_normals[0])]
        found = [{"POSITION": self.document.accessor(one, VERTICES, box=True)} for one in moved]
        if any(one.any() for one in turned):
            for target, one in zip(found, turned):
                target["NORMAL"] = self.document.accessor(one, VERTICES)
        return found

    def _put_parts(self, geometry: Geometry) -> list[tuple[int, int]]:
        """(part, accessor of its triangles) of the parts that have any."""
        dtype = "<u2" if geometry.keyed.shape[1] < _SMALL else "<u4"
        found = []
        for part in np.unique(geometry.parts):
            indices = geometry.indices[geometry.parts == part].astype(dtype).ravel()
            found.append((int(part), self.document.accessor(indices, INDICES)))
        return found


_SKIN = ("JOINTS", "WEIGHT")


def _clipped(geometry: Geometry) -> NdArray | None:
    colors = geometry.colors
    if colors is None:
        return None
    if colors.min() < 0 or colors.max() > 1:
        geometry.world.notes.add(geometry.name, "colours of vertices are clamped to [0, 1]")
    return np.clip(colors, 0, 1)
