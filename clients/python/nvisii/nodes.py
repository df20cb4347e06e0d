"""The nodes of a volume as NanoVDB would have them: which boxes of voxels are not empty."""

from __future__ import annotations

from typing import Any

import numpy as np

_SIDES = (8, 128, 4096)  # voxels of leaves, lower and upper nodes (Museth 2021, "NanoVDB")


class Nodes:
    """density: (X, Y, Z). origin: lower corner of voxel [0, 0, 0]."""

    def __init__(self, density: Any, origin: Any) -> None:
        self._origin = origin
        self._first = np.floor(origin + 0.5).astype(int)
        found = np.argwhere(density != 0)
        self._voxels = found + self._first
        self._values = density[density != 0]
        self._boxes: dict[int, list[tuple[Any, float]]] = {}

    def boxes(self, level: int) -> list[tuple[Any, float]]:
        """For each node its box (2, 3) and its largest value."""
        if level not in (0, 1, 2, 3):
            raise RuntimeError(f"level: 0 (leaves) to 3 (root), not {level}")
        if level not in self._boxes:
            self._boxes[level] = self._nodes(level)
        return self._boxes[level]

    def _nodes(self, level: int) -> list[tuple[Any, float]]:
        voxels, values = self._voxels, self._values
        if len(voxels) == 0:
            return []
        if level == 3:
            keys = np.zeros(len(voxels), dtype=int)
        else:
            cells = voxels // _SIDES[level]
            _, keys = np.unique(cells, axis=0, return_inverse=True)
        order = np.argsort(keys.reshape(-1), kind="stable")
        starts = np.flatnonzero(np.diff(keys.reshape(-1)[order], prepend=-1))
        low = np.minimum.reduceat(voxels[order], starts)
        high = np.maximum.reduceat(voxels[order], starts)
        largest = np.maximum.reduceat(values[order], starts)
        shift = self._origin - self._first
        low, high = low + shift, high + 1 + shift
        return [(np.stack(pair), float(top)) for *pair, top in zip(low, high, largest)]

    def box(self, level: int, index: int) -> Any:
        """(2, 3) float64."""
        return self._node(level, index)[0]

    def largest(self, level: int, index: int) -> float:
        return self._node(level, index)[1]

    def _node(self, level: int, index: int) -> tuple[Any, float]:
        nodes = self.boxes(level)
        if not 0 <= index < len(nodes):
            raise RuntimeError(f"node_idx: {index} of {len(nodes)} nodes of level {level}")
        return nodes[index]
