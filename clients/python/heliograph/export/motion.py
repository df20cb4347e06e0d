"""Poses of entities over time, as translation, rotation and scale. Used by the writers of files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._wire.arrays import NdArray
from ..values.pose import rotation_of_wxyz
from ..values.rotations import quaternions_of, slerp
from .world import Entity, World

_SHEAR = 1e-5  # of the longest axis: less is rounding


@dataclass(frozen=True)
class Track:
    """An entity's poses relative to its parent at K times (seconds), and their parts for
    interpolation. K is 1: it stands still.

    matrices: (K, 4, 4). translations: (K, 3), metres. rotations: (K, 4) w x y z, neighbours on the
    shorter arc. stretches: (K, 3, 3), symmetric.
    """

    times: NdArray
    matrices: NdArray
    translations: NdArray
    rotations: NdArray
    stretches: NdArray

    @property
    def moves(self) -> bool:
        return len(self.times) > 1

    @property
    def scales(self) -> NdArray:
        """(K, 3)."""
        return np.diagonal(self.stretches, axis1=1, axis2=2)

    @property
    def is_sheared(self) -> bool:
        """True if translation, rotation and scale alone do not make the motion."""
        off = self.stretches - self.scales[:, :, None] * np.eye(3)
        return bool(np.abs(off).max() > _SHEAR * np.abs(self.stretches).max())

    def at(self, time: float) -> NdArray:
        """(4, 4), the pose at a time."""
        place, share = between(self.times, time)
        if share == 0:
            return np.asarray(self.matrices[place])
        pair = [self.rotations[place], self.rotations[place + 1]]
        out = np.eye(4)
        turn = rotation_of_wxyz(slerp(pair[0], pair[1], share))
        out[:3, :3] = turn @ _mixed(self.stretches, place, share)
        out[:3, 3] = _mixed(self.translations, place, share)
        return out


def between(times: NdArray, time: float) -> tuple[int, float]:
    """The key before a time and the share of the next one; outside the keys they hold."""
    place = int(np.searchsorted(times, time, side="right")) - 1
    if place < 0 or place == len(times) - 1:
        return max(place, 0), 0.0
    return place, float((time - times[place]) / (times[place + 1] - times[place]))


def _mixed(values: NdArray, place: int, share: float) -> NdArray:
    return np.asarray((1 - share) * values[place] + share * values[place + 1])


def mixed_at(times: NdArray, values: NdArray, time: float) -> NdArray:
    """(K, ...) values at a time, linearly."""
    place, share = between(times, time)
    return np.asarray(values[place]) if share == 0 else _mixed(values, place, share)


def polar(linear: NdArray) -> tuple[NdArray, NdArray]:
    """Rotations and symmetric stretches (K, 3, 3) whose products these are; where there is a mirror
    the stretch has it (Shoemake & Duff 1992)."""
    u, sizes, v = np.linalg.svd(linear)
    rotation = u @ v
    stretch = np.swapaxes(v, -1, -2) @ (sizes[:, :, None] * v)
    sign = np.sign(np.linalg.det(rotation))[:, None, None]
    return rotation * sign, stretch * sign


def track_of(world: World, entity: Entity) -> Track:
    """The pose of an entity at its keys."""
    pose = entity.message.pose
    given = world.array(pose.matrices) if entity.message.HasField("pose") else np.eye(4)
    matrices = np.asarray(given, dtype="f8").reshape(-1, 4, 4)
    times = np.zeros(1)
    if len(matrices) > 1:
        times = np.asarray(world.array(pose.times), dtype="f8")
    rotations, stretches = polar(matrices[:, :3, :3])
    quaternions = quaternions_of(rotations)
    for k in range(1, len(quaternions)):
        if quaternions[k] @ quaternions[k - 1] < 0:
            quaternions[k] *= -1
    return Track(times, matrices, matrices[:, :3, 3], quaternions, stretches)


class Poses:
    """Tracks of all entities, and poses in the world."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.tracks = {key: track_of(world, entity) for key, entity in world.entities.items()}

    def world_at(self, key: int, time: float) -> NdArray:
        """(4, 4) world_from_entity."""
        matrix, parent = self.tracks[key].at(time), self.world.entities[key].parent
        while parent is not None:
            matrix = self.tracks[parent].at(time) @ matrix
            parent = self.world.entities[parent].parent
        return matrix

    def world_now(self, key: int) -> NdArray:
        return self.world_at(key, self.world.time)

    def times_above(self, key: int) -> NdArray:
        """Key times of an entity and of all above it, sorted; empty: it stands still."""
        found: list[NdArray] = []
        at: int | None = key
        while at is not None:
            found += [self.tracks[at].times] if self.tracks[at].moves else []
            at = self.world.entities[at].parent
        return np.unique(np.concatenate(found)) if found else np.zeros(0)
