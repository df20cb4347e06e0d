"""Many things at once in a camera's view. Used by the scene MESH."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import InvalidArgument
from ...scene.handles import flatten
from . import ranges
from .ranges import LogUniform

if TYPE_CHECKING:
    from ..draw import Draw


class Swarm:
    """Puts many things at points uniform in the volume that a camera sees between two depths, with
    any rotation and with new sizes; they may meet.

    camera: a perspective one. depth: metres along its axis, (nearest, farthest). size: metres for a
    thing that is 1 m large as it is. beyond: how much wider than the image the volume is.
    """

    def __init__(
        self,
        things: Any,
        camera: Any,
        *,
        depth: tuple[float, float],
        size: LogUniform,
        beyond: float = 1.1,
    ) -> None:
        self.things, self.camera, self.size = things, camera, size
        self.depth = ranges.checked_pair(depth, "depth", 1e-6)
        self.beyond = ranges.checked_number(beyond, "beyond", 0)

    def __call__(self, draw: Draw) -> None:
        things, rng = flatten(self.things, "things"), draw.rng
        camera = draw.scene[self.camera] if isinstance(self.camera, str) else self.camera
        lens = camera.camera
        if lens.projection != "perspective":
            raise InvalidArgument(f"camera: {camera!r} is not a perspective one", field="camera")
        near, far = self.depth
        count = len(things)
        depth = rng.uniform(near**3, far**3, count) ** (1 / 3)
        half = 0.5 * self.beyond * np.array([lens.width / lens.fx, lens.height / lens.fy])
        middle = np.array([lens.width / 2 - 0.5 - lens.cx, lens.cy + 0.5 - lens.height / 2])
        across = middle / (lens.fx, lens.fy) + rng.uniform(-half, half, (count, 2))
        points = np.column_stack([across * depth[:, None], -depth])
        pose = draw.pose(camera)
        poses = np.tile(np.eye(4), (count, 1, 1))
        sizes = self.size.low * (self.size.high / self.size.low) ** rng.random(count)
        poses[:, :3, :3] = rotations(rng, count) * sizes[:, None, None]
        poses[:, :3, 3] = points @ pose[:3, :3].T + pose[:3, 3]
        draw.place(things, poses)


def rotations(rng: np.random.Generator, count: int) -> NdArray:
    """(N, 3, 3), each uniform over all rotations: of normal quaternions (Muller 1959)."""
    q = rng.normal(size=(count, 4))
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
