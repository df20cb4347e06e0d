"""The nodes of a volume as NanoVDB would have them: which boxes of voxels are not empty."""

from __future__ import annotations

from typing import Any

import numpy as np

_LEAF = 8  # voxels along a side of a leaf
_LEAVES = (1, 16, 512)  # leaves along a side of a leaf, a lower and an upper node (Museth 2021)


class Nodes:
    """density: (X, Y, Z). origin: lower corner of voxel [0, 0, 0]."""

    def __init__(self, density: Any, origin: Any) -> None:
        first = np.floor(origin + 0.5).astype(int)  # the number of voxel [0, 0, 0]
        start = first - first % _LEAF
        rest = -(first + density.shape) % _LEAF
        blocks = np.pad(density, list(zip(first - start, rest)))
        counts = np.array(blocks.shape) // _LEAF
        blocks = blocks.reshape([n for count in counts for n in (count, _LEAF)])
        active = blocks != 0
        used = active.any(axis=(1, 3, 5))
        self._cells = np.argwhere(used) + start // _LEAF
        self._largest = np.where(active, blocks, -np.inf).max(axis=(1, 3, 5))[used]
        low, high = (np.empty((len(self._cells), 3)) for _ in range(2))
        for axis in range(3):
            others = tuple(2 * k + 1 for k in range(3) if k != axis)
            there = np.moveaxis(active.any(axis=others), axis + 1, -1)[used]
            low[:, axis] = there.argmax(axis=1)
            high[:, axis] = _LEAF - there[:, ::-1].argmax(axis=1)
        corner = self._cells * _LEAF + (origin - first)
        self._low, self._high = corner + low, corner + high
        self._boxes: dict[int, list[tuple[Any, float]]] = {}

    def boxes(self, level: int) -> list[tuple[Any, float]]:
        """Box (2, 3) and largest value of each node. level: 0 (leaves) to 3 (root)."""
        if level not in (0, 1, 2, 3):
            raise RuntimeError(f"level: 0 (leaves) to 3 (root), not {level}")
        if level not in self._boxes:
            self._boxes[level] = self._nodes(level)
        return self._boxes[level]

    def _nodes(self, level: int) -> list[tuple[Any, float]]:
        if len(self._cells) == 0:
            return []
        keys = np.zeros(len(self._cells), dtype=int)
        if level < 3:
            nodes = self._cells // _LEAVES[level]
            keys = np.unique(nodes, axis=0, return_inverse=True)[1].reshape(-1)
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
        low = np.minimum.reduceat(self._low[order], starts)
        high = np.maximum.reduceat(self._high[order], starts)
        largest = np.maximum.reduceat(self._largest[order], starts)
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
