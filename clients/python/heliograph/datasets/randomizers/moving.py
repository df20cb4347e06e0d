"""camera_path and random_motion: moving cameras and things, with their flow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray, checked
from ...errors import InvalidArgument
from ...scene.handles import Handle, flatten
from ...values.checks import whole_of
from ...values.pose import look_at
from ..bodies import middle
from . import ranges
from .ranges import Range

if TYPE_CHECKING:
    from ..draw import Draw

_OCTAVES = 5
_PIECES = 200
_SLOWEST = 0.4  # Hz


class CameraPath:
    """A camera on a path, one step per image, held by a hand.

    points: (P, 3) world metres, P > 1, on a centripetal Catmull-Rom curve (Yuksel et al. 2011),
    which is run through in `frames` images at an even speed; later images begin anew. target:
    entities whose middle, or the point, that it looks at; None: along the path. loop: the last
    point leads to the first one. interval: seconds between two images. handheld: metres, and sway:
    radians, root mean squares of the noise of each component of the position and the direction; it
    is smooth in time, with 1/f amplitudes from 0.4 Hz on, the same for a seed of the data set.

    Image i is taken at the scene's time; the camera has keys an interval before and after: flow has
    both its ends, and shutters blur.
    """

    def __init__(
        self,
        camera: Any,
        points: Any,
        *,
        frames: int,
        target: Any = None,
        loop: bool = False,
        interval: float = 1 / 30,
        handheld: float = 0.0,
        sway: float = 0.0,
    ) -> None:
        self.camera, self.target, self.loop = camera, target, bool(loop)
        self.points = checked(points, "points", "f8", (None, 3))
        ring = np.concatenate([self.points, self.points[: int(self.loop)]])
        if len(self.points) < 2 or (np.diff(ring, axis=0) == 0).all(axis=1).any():
            raise InvalidArgument(
                "points: needs at least two, each unlike the next; a loop's first follows its last",
                field="points",
            )
        self._curve = _curve(self.points, self.loop)
        lengths = np.linalg.norm(np.diff(self._curve, axis=0), axis=1)
        self._shares = np.concatenate([[0], np.cumsum(lengths) / lengths.sum()])
        self.frames = whole_of(frames, "frames", 2)
        self.interval = ranges.checked_number(interval, "interval", 1e-9)
        self.handheld = ranges.checked_number(handheld, "handheld", 0)
        self.sway = ranges.checked_number(sway, "sway", 0)

    def __call__(self, draw: Draw) -> None:
        step = draw.index % self.frames
        now = draw.scene.time
        poses = {k: self._pose(draw, step + k) for k in (-1, 0, 1)}
        draw.place([self.camera], [poses[0]])
        local = {k: draw.locals([self.camera], [pose])[0] for k, pose in poses.items()}
        keys = {now + k * self.interval: pose for k, pose in local.items()}
        draw.edit.update(self.camera, keys=keys)

    def _pose(self, draw: Draw, step: int) -> NdArray:
        last = self.frames if self.loop else self.frames - 1
        place = self._at(step / last)
        noise = self._noise(draw.seed, step * self.interval)
        eye = place + self.handheld * noise[:3]
        if self.target is None:
            ahead = self._at((step + 0.5) / last) - self._at((step - 0.5) / last)
            at = eye + ahead
        else:
            at = middle(draw, self.target)
        pose = look_at(eye, at)
        angle = self.sway * noise[3:]
        length = float(np.linalg.norm(angle))
        if length > 0:
            pose[:3, :3] = pose[:3, :3] @ ranges.turn(angle / length, length)
        return pose

    def _at(self, share: float) -> NdArray:
        """(3,) of the curve at a share of its length: 0 its first point, 1 its last one; straight
        on beyond them."""
        if self.loop:
            share %= 1.0
        elif not 0 <= share <= 1:
            end = min(max(share, 0.0), 1.0)
            tangent = self._at(abs(end - 1e-3)) - self._at(end)
            return self._at(end) - tangent * abs(share - end) / 1e-3
        return np.array([np.interp(share, self._shares, column) for column in self._curve.T])

    def _noise(self, seed: int, t: float) -> NdArray:
        """(6,) at t seconds; mean 0, mean square 1 over time."""
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_OCTAVES,)))
        phases = rng.uniform(0, 2 * math.pi, (_OCTAVES, 6))
        rates = rng.uniform(0.8, 1.25, (_OCTAVES, 6))
        powers = 2.0 ** np.arange(_OCTAVES)[:, None]
        waves = np.sin(2 * math.pi * _SLOWEST * powers * rates * t + phases) / powers
        return np.asarray(waves.sum(axis=0) / math.sqrt(0.5 * (powers**-2.0).sum()))


def _curve(points: NdArray, loop: bool) -> NdArray:
    """(N, 3): points of the curve, many from one given point to the next."""
    if loop:
        p = np.concatenate([points[-1:], points, points[:2]])
    else:
        p = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    knots = np.cumsum(np.sqrt(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)))
    out = [p[1:2]]
    for i in range(1, len(p) - 2):
        for t in np.linspace(knots[i], knots[i + 1], _PIECES + 1)[1:]:
            out.append(_catmull_rom(p[i - 1 : i + 3], knots[i - 1 : i + 3], t)[None])
    return np.concatenate(out)


def _catmull_rom(p: NdArray, knots: NdArray, t: float) -> NdArray:
    """Barry and Goldman 1988, "A Recursive Evaluation Algorithm for a Class of Catmull-Rom
    Splines": the point at t, knots[1] <= t <= knots[2]."""
    for width in (1, 2):
        weights = [(t - knots[i]) / (knots[i + width] - knots[i]) for i in range(4 - width)]
        p = np.array([(1 - w) * p[i] + w * p[i + 1] for i, w in enumerate(weights)])
    w = (t - knots[1]) / (knots[2] - knots[1])
    return np.asarray((1 - w) * p[0] + w * p[1])


class RandomMotion:
    """Lets things and cameras move evenly up to the poses that were drawn for them.

    things: entities. speed: metres per second, in any direction. spin: radians per second about any
    axis through the entity's origin. interval: seconds of the step that led here; the scene's time
    grows by it, and flow is backward over it. Run it last: a thing that is placed later has no
    flow.
    """

    def __init__(
        self, things: Any, *, speed: Range = 0.0, spin: Range = 0.0, interval: float = 1 / 30
    ) -> None:
        self.things = things
        self.speed = ranges.checked_range(speed, "speed", 0)
        self.spin = ranges.checked_range(spin, "spin", 0)
        self.interval = ranges.checked_number(interval, "interval", 1e-9)

    def __call__(self, draw: Draw) -> None:
        things: list[Handle | str] = flatten(self.things, "things")
        now = [draw.pose(thing) for thing in things]
        before = []
        for pose in now:
            way = ranges.direction(draw.rng) * ranges.number(draw.rng, self.speed)
            axis, spin = ranges.direction(draw.rng), ranges.number(draw.rng, self.spin)
            old = pose.copy()
            old[:3, 3] -= self.interval * way
            old[:3, :3] = ranges.turn(axis, -self.interval * spin) @ pose[:3, :3]
            before.append(old)
        draw.place(things, before)
        draw.edit.advance(self.interval)
        draw.place(things, now)
