"""Finds poses of things where nothing intersects. Used by scatter and in_volume."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ..bodies import Body, box_of, published
from ..tries import gave_up

if TYPE_CHECKING:
    from ...client.scene import Scene
    from ..draw import Draw


class Apart:
    """Draws poses until all things are clear of each other and of the rest of the scene.

    In each round every thing without a place gets a pose; in their order they keep it if they meet
    nothing that has its place, by the surfaces' triangles (Scene.overlaps), and if their world box
    is at least `spacing` metres from the others'.
    """

    def __init__(self, things: Sequence[Body], obstacles: Sequence[Body], spacing: float) -> None:
        self.things = list(things)
        self.obstacles = [mesh for body in obstacles for mesh in body.meshes]
        self.spacing = spacing

    def place(self, draw: Draw, propose: Callable[[Body], NdArray], tries: int) -> None:
        """propose: the (4, 4) world pose of a body; called up to `tries` times for each."""
        if not self.things:
            return
        poses: list[NdArray] = [np.eye(4)] * len(self.things)
        placed: list[int] = []
        missing = list(range(len(self.things)))
        with published(draw) as branch:
            for _ in range(tries):
                for i in missing:
                    poses[i] = propose(self.things[i])
                self._publish(draw, branch, missing, poses)
                meets = self._meets(branch, missing)
                boxes = self._boxes(poses) if self.spacing > 0 else None
                for row, i in enumerate(missing):
                    near = boxes is not None and _near(boxes, i, placed, self.spacing)
                    if not near and not meets[row, -1] and not meets[row, placed].any():
                        placed.append(i)
                missing = [i for i in missing if i not in placed]
                if not missing:
                    draw.place([body.root for body in self.things], poses)
                    return
        raise gave_up(
            f"things: {len(missing)} of {len(self.things)} found no free place in {tries} tries; "
            "give more room (radius=, on=, box=), less spacing=, or more tries=",
            "tries",
            tries,
        )

    def _publish(
        self, draw: Draw, branch: Scene, chosen: Sequence[int], poses: Sequence[NdArray]
    ) -> None:
        roots = [self.things[i].root for i in chosen]
        with branch.edit() as edit:
            edit.set_transforms(roots, draw.locals(roots, [poses[i] for i in chosen]))

    def _meets(self, branch: Scene, chosen: Sequence[int]) -> NdArray:
        """(chosen, things + 1) bool: intersections with each thing, and, last, with any
        obstacle."""
        mine = [mesh for i in chosen for mesh in self.things[i].meshes]
        all_ = [mesh for body in self.things for mesh in body.meshes]
        pairs = branch.overlaps(mine, [*all_, *self.obstacles])
        rows = np.cumsum([0, *(len(self.things[i].meshes) for i in chosen)])
        columns = np.cumsum([0, *(len(body.meshes) for body in self.things)])
        pairs = np.logical_or.reduceat(pairs, rows[:-1], axis=0)
        obstacles = pairs[:, columns[-1] :].any(axis=1, keepdims=True)
        things = np.logical_or.reduceat(pairs[:, : columns[-1]], columns[:-1], axis=1)
        return np.concatenate([things, obstacles], axis=1)

    def _boxes(self, poses: Sequence[NdArray]) -> NdArray:
        """(things, 2, 3) world boxes."""
        return np.array([box_of(b.world(pose)) for b, pose in zip(self.things, poses)])


def _near(boxes: Any, i: int, others: Sequence[int], spacing: float) -> bool:
    """True if the box of i is closer than `spacing`, metres, to another one's."""
    low, high = boxes[others, 0], boxes[others, 1]
    gap = np.maximum(0, np.maximum(low - boxes[i, 1], boxes[i, 0] - high))
    return bool((np.linalg.norm(gap, axis=1) < spacing).any())
