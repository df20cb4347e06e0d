"""Animations of glTF: keys of poses, of morph weights and of vertices, as one clip.

Source: glTF 2.0, 3.11. Between keys both mix translations and scales linearly and rotations by
slerp, vertices and weights linearly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ..geometry import Geometry
from ..motion import Track, mixed_at
from ..world import Entity, World
from .document import Document


class Clip:
    """The one animation of a document, as it grows."""

    def __init__(self, world: World, document: Document) -> None:
        self.world = world
        self.document = document
        self._channels: list[tuple[int, str, NdArray, NdArray]] = []  # node, path, times, values

    def put_pose(self, node: int, track: Track) -> None:
        turns = np.roll(track.rotations, -1, axis=1)
        for path, values in (
            ("translation", track.translations),
            ("rotation", turns),
            ("scale", track.scales),
        ):
            if np.ptp(values, axis=0).max() > 0:
                self._channels.append((node, path, track.times, values))

    def put_weights(self, node: int, times: NdArray, weights: NdArray) -> None:
        """(K,) seconds and (K, T)."""
        self._channels.append((node, "weights", times, weights))

    def write(self) -> None:
        """Adds it to the document, if anything moves."""
        if not self._channels:
            return
        first = min(times[0] for _, _, times, _ in self._channels)
        if first < 0:
            self.world.notes.add(
                "its clip", f"times begin at 0: {-first:g} s are added to all keys"
            )
        found: dict[str, Any] = {"name": "motion", "channels": [], "samplers": []}
        inputs: dict[bytes, int] = {}
        for node, path, times, values in self._channels:
            kept, places = self._kept(times - min(first, 0))
            key = kept.tobytes()
            if key not in inputs:
                inputs[key] = self.document.accessor(kept, box=True)
            values = values[places].astype("<f4")
            output = values.ravel() if path == "weights" else values
            sampler = {"input": inputs[key], "output": self.document.accessor(output)}
            found["samplers"].append({**sampler, "interpolation": "LINEAR"})
            target = {"node": node, "path": path}
            found["channels"].append({"sampler": len(found["samplers"]) - 1, "target": target})
        self.document.add("animations", found)

    def _kept(self, times: NdArray) -> tuple[NdArray, NdArray]:
        """Times that differ in float32, and their indices in `times`."""
        kept, places = np.unique(times.astype("<f4"), return_index=True)
        if len(kept) < len(times):
            self.world.notes.add("its clip", "keys that float32 does not tell apart are left out")
        return kept, places


def weights_of(world: World, entity: Entity, geometry: Geometry) -> tuple[NdArray, NdArray]:
    """(K,) times and (K, T) weights of the targets in meshes.py: morphs, then keys of vertices."""
    message = entity.message.morph_weights
    given = world.optional(message, "weights")
    own = np.zeros((1, len(geometry.morphs))) if given is None else np.atleast_2d(given)
    if not own.shape[1]:
        own = np.zeros((1, len(geometry.morphs)))
    own_times = np.asarray(world.array(message.times)) if len(own) > 1 else np.zeros(1)
    keys = np.eye(len(geometry.times))[:, 1:]  # of each key all of its own target
    moving = [t for t in (own_times, geometry.times) if len(t) > 1]
    times = np.unique(np.concatenate(moving)) if moving else np.zeros(1)
    rows = [
        np.concatenate([mixed_at(own_times, own, t), mixed_at(geometry.times, keys, t)])
        for t in times
    ]
    return times, np.array(rows)
