"""Poses of the rows of a picture with a rolling shutter, from its own points. Used by
frame_planes.py."""

from __future__ import annotations

import numpy as np

from ..._wire.arrays import NdArray

_WORST = 8
_FLAT = 1e-3  # of a row's points: with less beside their line, their turn about it is unknown


class RowPoses:
    """Poses of rows: bring each row's points of the world (H, W, 3) to the camera (H, W, 3), where
    they are known: `within` is finite, m that rounding may leave.

    error: (H, W) m that the best rigid transform of a row leaves (Kabsch 1976), but for up to
    eight points that fit worst. turns: (H, 3, 3) rotations, nan where a row's points lie on a line.
    """

    def __init__(self, world: NdArray, camera: NdArray, within: NdArray) -> None:
        hit = np.isfinite(within)
        self.error = np.zeros(hit.shape)
        self.turns = np.full((len(hit), 3, 3), np.nan)
        for y in np.flatnonzero(hit.sum(1) >= 3):
            a, b, bound = world[y, hit[y]], camera[y, hit[y]], within[y, hit[y]]
            kept = np.ones(len(a), bool)
            for _ in range(_WORST + 1):
                turn, place, spread = _fit(a[kept], b[kept])
                error = np.abs(a @ turn.T + place - b).max(1)
                if (error <= bound)[kept].all() or kept.sum() < 4:
                    break
                kept[np.argmax(np.where(kept, error / bound, 0))] = False
            self.error[y, hit[y]] = error
            if spread > _FLAT:
                self.turns[y] = turn


def _fit(a: NdArray, b: NdArray) -> tuple[NdArray, NdArray, float]:
    """Rotation, translation, and how far the points are beside their line, of how long it is."""
    from_a, from_b = a - a.mean(0), b - b.mean(0)
    u, size, v = np.linalg.svd(from_b.T @ from_a)
    turn = (u * (1, 1, np.sign(np.linalg.det(u @ v)))) @ v
    spread = float(np.sqrt(size[1] / max(size[0], 1e-30)))
    return turn, b.mean(0) - turn @ a.mean(0), spread


def middle_error(error: NdArray, hit: NdArray) -> tuple[float, float]:
    """Error that a pose leaves (H, W) in the middle rows, whose pose it is; and the part that even
    motion makes of it there, by its growth towards the other rows."""
    rows = np.flatnonzero(hit.any(1))
    away = np.abs(rows - (len(hit) - 1) / 2)
    left = np.array([np.median(error[y, hit[y]]) for y in rows])
    near = away <= max(0.5, len(hit) / 8)
    if not near.any() or near.all():
        return 0.0, 0.0
    speed = float(np.median(left[~near] / away[~near]))
    worst = int(np.argmax(np.where(near, left, -1)))
    return float(left[worst]), 2 * speed * float(max(away[worst], 0.5))
