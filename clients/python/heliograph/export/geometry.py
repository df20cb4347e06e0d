"""Meshes as arrays that files take: unit normals, distinct joints. Used by the writers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire.arrays import NdArray
from .motion import mixed_at
from .world import World

_SHORT = 1e-12  # of normals and tangents: they have no direction


@dataclass(frozen=True)
class Geometry:
    """The arrays of a Mesh, read at first use. V vertices, F triangles, T targets."""

    world: World
    name: str
    message: pb.Mesh

    def _array(self, name: str) -> NdArray | None:
        return self.world.optional(self.message, name)

    @cached_property
    def times(self) -> NdArray:
        """(K,) seconds of the keys of vertices; K is 1: they stand still."""
        found = self._array("times")
        return np.zeros(1) if found is None else np.asarray(found, dtype="f8")

    @cached_property
    def keyed(self) -> NdArray:
        """(K, V, 3) positions, metres."""
        return np.asarray(self._array("positions")).reshape(len(self.times), -1, 3)

    @cached_property
    def indices(self) -> NdArray:
        """(F, 3) uint32."""
        return np.asarray(self._array("indices"))

    @cached_property
    def keyed_normals(self) -> NdArray | None:
        """Normals (K, V, 3) of length 1; a vertex without a direction gets that of its faces."""
        found = self._array("normals")
        if found is None:
            return None
        normals = found.reshape(self.keyed.shape).astype("f8")
        pairs = zip(normals, self.keyed)
        return np.stack([_unit(one, points, self.indices) for one, points in pairs]).astype("f4")

    @cached_property
    def uvs(self) -> list[NdArray]:
        """(V, 2) of set 0 and 1, as many as there are; where only 1 is, 0 is zeros."""
        first, second = self._array("uvs"), self._array("uvs1")
        if first is None and second is not None:
            first = np.zeros_like(second)
        return [uvs for uvs in (first, second) if uvs is not None]

    @cached_property
    def colors(self) -> NdArray | None:
        """(V, 4) float32, linear."""
        return self._array("colors")

    @cached_property
    def tangents(self) -> NdArray | None:
        """(V, 4) float32 of length 1, w is 1 or -1; None: no directions, or some have no length."""
        found = self._array("tangents")
        if found is None:
            return None
        lengths = np.linalg.norm(found[:, :3].astype("f8"), axis=1, keepdims=True)
        if (lengths < _SHORT).any():
            self.world.notes.add(self.name, "tangents are left out: some have no length")
            return None
        signs = np.where(found[:, 3:] < 0, -1.0, 1.0)
        return np.hstack([found[:, :3] / lengths, signs]).astype("f4")

    @cached_property
    def parts(self) -> NdArray:
        """(F,) the part of each triangle."""
        found = self._array("parts")
        return np.zeros(len(self.indices), "u4") if found is None else found

    def part_name(self, part: int) -> str:
        names = self.message.part_names
        return str(names[part]) if part < len(names) else ""

    @cached_property
    def influences(self) -> tuple[NdArray, NdArray] | None:
        """(V, 4) uint16 joints, each once per vertex, and their float32 weights, of sum 1."""
        joints, weights = self._array("joints"), self._array("weights")
        return None if joints is None or weights is None else _merged(joints, weights)

    @cached_property
    def morphs(self) -> NdArray:
        """(T, V, 3) offsets of positions by morph targets."""
        found = self._array("morph_positions")
        return np.zeros((0, *self.keyed.shape[1:]), "f4") if found is None else found

    @cached_property
    def morph_normals(self) -> NdArray | None:
        return None if self.keyed_normals is None else self._array("morph_normals")

    # ------------------------------------------------------------ at a time

    def positions_at(self, time: float, weights: NdArray | None = None) -> NdArray:
        """(V, 3) float32 at a time, with (T,) weights of the targets."""
        found = mixed_at(self.times, self.keyed, time)
        if weights is not None and np.any(weights):
            found = found + np.tensordot(weights, self.morphs, 1)
        return np.asarray(found, dtype="f4")

    def normals_at(self, time: float, weights: NdArray | None = None) -> NdArray | None:
        """(V, 3) float32, of length 1."""
        if self.keyed_normals is None:
            return None
        found = mixed_at(self.times, self.keyed_normals, time)
        if weights is not None and np.any(weights) and self.morph_normals is not None:
            found = found + np.tensordot(weights, self.morph_normals, 1)
        points = self.positions_at(time, weights)
        return _unit(found.astype("f8"), points, self.indices).astype("f4")


class Geometries:
    """The meshes of a world, each read once."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._found: dict[int, Geometry] = {}

    def __getitem__(self, key: int) -> Geometry:
        if key not in self._found:
            shared = self.world.shared[key]
            self._found[key] = Geometry(self.world, shared.name or f"mesh {key}", shared.message)
        return self._found[key]


def _unit(normals: NdArray, points: NdArray, indices: NdArray) -> NdArray:
    """Normals (V, 3) of length 1; a vertex without one gets the mean of the faces about it."""
    lengths = np.linalg.norm(normals, axis=1)
    short = lengths < _SHORT
    if short.any():
        normals = np.where(short[:, None], _face_means(points, indices), normals)
        lengths = np.linalg.norm(normals, axis=1)
        normals[lengths < _SHORT] = (0, 0, 1)  # no face, or faces without an area
        lengths = np.linalg.norm(normals, axis=1)
    return np.asarray(normals / lengths[:, None])


def _face_means(points: NdArray, indices: NdArray) -> NdArray:
    a, b, c = (points[indices[:, i]].astype("f8") for i in range(3))
    face = np.cross(b - a, c - a)
    sums = np.zeros((len(points), 3))
    for i in range(3):
        np.add.at(sums, indices[:, i], face)
    return sums


def _merged(joints: NdArray, weights: NdArray) -> tuple[NdArray, NdArray]:
    """Adds up the weights of one joint; joints without weight become joint 0."""
    summed, kept = weights.astype("f8"), joints.copy()
    for i in range(4):
        for j in range(i + 1, 4):
            same = (joints[:, i] == joints[:, j]) & (summed[:, j] > 0)
            summed[same, i] += summed[same, j]
            summed[same, j] = 0
    kept[summed <= 0] = 0
    found: Any = (summed / summed.sum(axis=1, keepdims=True)).astype("f4")
    return kept, found
