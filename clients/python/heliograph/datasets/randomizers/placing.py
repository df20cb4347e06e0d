"""scatter, in_volume, shell: where things are."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray, checked
from ...errors import InvalidArgument
from ...values.checks import whole_of
from ..bodies import Body, box_of, middle
from ..tries import gave_up
from . import ranges
from .apart import Apart
from .ranges import Range
from .surface import Patch, Surface

if TYPE_CHECKING:
    from ..draw import Draw

_COVERED = 0.25  # share of the default disc that the things' own discs take
_LIFT = 1e-4  # of a thing's size: how far above the surface it is put, so that float32 cannot cut


class Scatter:
    """Puts things onto a surface, nowhere intersecting: each at a point uniform over the area.

    things: entities, groups, assets. on: entities or names whose upward faces carry them, up to
    max_slope radians from the horizontal. upright: turned about the surface's normal alone, from
    the pose that they have; False: any rotation, uniformly, resting on the lowest vertex. around,
    radius: only points within so many metres of a point or an entity's middle, default the
    surface's middle; radius default: a disc four times as large as the things' own, math.inf: the
    whole surface. spacing: metres between the things' world boxes. overhang: True lets things reach
    over the surface's edge. avoid: further entities that they may not intersect.
    tries: poses for a thing before ResourceExhausted.

    Tests for intersection with each other, the surface and `avoid` use the triangles of rest shapes
    at the scene's time. On a curved surface things touch the tangent plane.
    """

    def __init__(
        self,
        things: Any,
        *,
        on: Any,
        upright: bool = True,
        around: Any = None,
        radius: float | None = None,
        spacing: float = 0.0,
        overhang: bool = False,
        avoid: Any = (),
        max_slope: float = math.pi / 4,
        tries: int = 200,
    ) -> None:
        self.things, self.on, self.avoid = things, on, avoid
        self.upright, self.overhang = bool(upright), bool(overhang)
        self.around = around
        self.spacing = ranges.checked_number(spacing, "spacing", 0)
        self.max_slope = ranges.checked_number(max_slope, "max_slope", 0, math.pi / 2)
        self.tries = whole_of(tries, "tries", 1)
        self.radius = radius
        if radius is not None and radius != math.inf:
            self.radius = ranges.checked_number(radius, "radius", 1e-9)

    def __call__(self, draw: Draw) -> None:
        bodies = draw.bodies.of(self.things, "things")
        if not bodies:
            return
        surface = Surface(draw, self.on, self.max_slope)
        base = {id(body): draw.pose(body.root) for body in bodies}
        around = surface.middle if self.around is None else middle(draw, self.around, "around")
        patch = surface.within(around, self._radius(bodies, base))

        def propose(body: Body) -> NdArray:
            for _ in range(self.tries):
                pose, foot = self._stand(draw.rng, body, base[id(body)], patch)
                if self.overhang or surface.carries(foot, 0.05 * float(np.ptp(foot)) + 1e-6):
                    return pose
            raise gave_up(
                f"things: {body.root!r} never stood whole on the surface in {self.tries} tries; "
                "give a larger surface, overhang=True, or more tries=",
                "tries",
                self.tries,
            )

        obstacles = draw.bodies.of(self.on, "on")
        obstacles += draw.bodies.of(self.avoid, "avoid")
        Apart(bodies, obstacles, self.spacing).place(draw, propose, self.tries)

    def _radius(self, bodies: list[Body], base: dict[int, NdArray]) -> float:
        if self.radius is not None:
            return self.radius
        total = 0.0
        for body in bodies:
            low, high = box_of(body.world(base[id(body)]))
            size = high[:2] - low[:2] if self.upright else high - low
            total += (0.5 * float(np.linalg.norm(size)) + 0.5 * self.spacing) ** 2
        return math.sqrt(total / _COVERED)

    def _stand(
        self, rng: np.random.Generator, body: Body, base: NdArray, patch: Patch
    ) -> tuple[NdArray, NdArray]:
        """World pose that touches the surface, and (4, 3) corners of the area that it covers."""
        point, normal = patch.point(rng)
        if self.upright:
            turned = ranges.turn(normal, 2 * math.pi * rng.random()) @ ranges.turn_onto(normal)
        else:
            turned = ranges.rotation(rng)
        pose = np.eye(4)
        pose[:3, :3] = turned @ base[:3, :3]
        offsets = body.positions @ pose[:3, :3].T
        heights = offsets @ normal
        side = ranges.turn_onto(normal)[:, :2]  # two directions in the surface
        low, high = box_of(offsets @ side)
        lift = _LIFT * float(np.ptp(heights) + np.ptp(low)) + 1e-6 * float(np.abs(point).max())
        pose[:3, 3] = point - side @ (0.5 * (low + high)) + (lift - heights.min()) * normal
        half = 0.5 * (high - low)
        around = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
        return pose, point + around @ side.T


class InVolume:
    """Puts things at points uniform in a box.

    box: (low, high) corners, world metres; or an entity, whose world box it is. rotate: any
    rotation, uniformly; False: as they are. apart: nowhere intersecting each other or `avoid`, as
    in Scatter; False: wherever they are drawn. spacing, tries: as in Scatter.
    """

    def __init__(
        self,
        things: Any,
        box: Any,
        *,
        rotate: bool = True,
        apart: bool = True,
        spacing: float = 0.0,
        avoid: Any = (),
        tries: int = 200,
    ) -> None:
        self.things, self.box, self.avoid = things, box, avoid
        self.rotate, self.apart = bool(rotate), bool(apart)
        self.spacing = ranges.checked_number(spacing, "spacing", 0)
        self.tries = whole_of(tries, "tries", 1)
        if np.shape(box) == (2, 3):
            low, high = checked(box, "box", "f8", (2, 3))
            if (low > high).any():
                raise InvalidArgument("box: the first corner is the lower one", field="box")

    def __call__(self, draw: Draw) -> None:
        bodies = draw.bodies.of(self.things, "things")
        base = {id(body): draw.pose(body.root) for body in bodies}
        low, high = self._corners(draw)

        def propose(body: Body) -> NdArray:
            pose = base[id(body)].copy()
            if self.rotate:
                pose[:3, :3] = ranges.rotation(draw.rng) @ pose[:3, :3]
            pose[:3, 3] = 0
            corners = box_of(body.world(pose))
            pose[:3, 3] = draw.rng.uniform(low, high) - 0.5 * (corners[0] + corners[1])
            return pose

        if self.apart:
            obstacles = draw.bodies.of(self.avoid, "avoid")
            Apart(bodies, obstacles, self.spacing).place(draw, propose, self.tries)
        else:
            draw.place([body.root for body in bodies], [propose(body) for body in bodies])

    def _corners(self, draw: Draw) -> tuple[NdArray, NdArray]:
        if np.shape(self.box) == (2, 3):
            low, high = np.asarray(self.box, dtype="f8")
            return low, high
        boxes = [box_of(b.world(draw.pose(b.root))) for b in draw.bodies.some(self.box, "box")]
        return np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)


class Shell:
    """Puts entities at points uniform in the volume of a part of a spherical shell.

    around: a point (3,), or entities whose middle it is. radius: (inner, outer) metres.
    elevation, azimuth: radians above the horizon and about +Z from +X. rotate: any rotation,
    uniformly; False: as they are. For cameras see orbit.
    """

    def __init__(
        self,
        things: Any,
        around: Any,
        *,
        radius: tuple[float, float] | float,
        elevation: Range = (-math.pi / 2, math.pi / 2),
        azimuth: Range = (0.0, 2 * math.pi),
        rotate: bool = True,
    ) -> None:
        self.things, self.around, self.rotate = things, around, bool(rotate)
        self.radius = ranges.checked_pair(radius, "radius", 0)
        self.elevation = ranges.checked_range(
            elevation, "elevation", -math.pi / 2 - 1e-6, math.pi / 2 + 1e-6
        )
        self.azimuth = ranges.checked_range(azimuth, "azimuth")

    def __call__(self, draw: Draw) -> None:
        from ...scene.handles import flatten

        things = flatten(self.things, "things")
        around = middle(draw, self.around, "around")
        inner, outer = self.radius
        poses = []
        for thing in things:
            pose = draw.pose(thing)
            if self.rotate:
                pose[:3, :3] = ranges.rotation(draw.rng) @ pose[:3, :3]
            radius = draw.rng.uniform(inner**3, outer**3) ** (1 / 3)
            way = ranges.direction(draw.rng, self.elevation, self.azimuth)
            pose[:3, 3] = around + radius * way
            poses.append(pose)
        draw.place(things, poses)
