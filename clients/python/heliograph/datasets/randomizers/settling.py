"""settle: things fall and come to rest, by PyBullet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._optional import needed
from ..._wire.arrays import NdArray
from ...errors import InvalidArgument
from ..bodies import Body, box_of
from . import ranges
from .ranges import Range

if TYPE_CHECKING:
    from ..draw import Draw

_GRAVITY = 9.81
_STEPS = 240  # a second of a world where things are 1 m large
_PATIENCE = 10.0  # seconds of that world
_DIRECTIONS = 400


class Settle:
    """Lets things fall from the poses that they have, and puts them where they are then.

    things: entities, each a rigid body: the convex hull of its vertices, of even density. on:
    entities that stay where they are, by their triangles. seconds: how long they fall, a Range; by
    default until they rest, at most as long as 10 s are to things 1 m large. friction,
    restitution: of every contact. velocity: metres per second, of any direction, at the beginning;
    spin: radians per second.

    Things must not meet at the beginning (InVolume and Scatter see to it); what leaves the surface
    falls on. Needs PyBullet: pip install 'heliograph[physics]'. It is run in DIRECT mode, in a
    world scaled so that the things' mean size is 1 m, because its margins are absolute. The same
    PyBullet on the same machine gives the same poses.
    """

    def __init__(
        self,
        things: Any,
        *,
        on: Any,
        seconds: Range | None = None,
        friction: float = 0.6,
        restitution: float = 0.1,
        velocity: Range = 0.0,
        spin: Range = 0.0,
    ) -> None:
        self.things, self.on = things, on
        self.seconds = None if seconds is None else ranges.checked_range(seconds, "seconds", 0)
        self.friction = ranges.checked_number(friction, "friction", 0)
        self.restitution = ranges.checked_number(restitution, "restitution", 0, 1)
        self.velocity = ranges.checked_range(velocity, "velocity", 0)
        self.spin = ranges.checked_range(spin, "spin", 0)

    def __call__(self, draw: Draw) -> None:
        bodies = draw.bodies.of(self.things, "things")
        fixed = draw.bodies.of(self.on, "on")
        both = [body.root for body in bodies if body in fixed]
        if both:
            raise InvalidArgument(f"on: {both[0]!r} is among the things that fall", field="on")
        if not bodies:
            return
        poses = [draw.pose(body.root) for body in bodies]
        ends = [box_of(body.world(pose)) for body, pose in zip(bodies, poses)]
        world = _World(float(np.mean([np.linalg.norm(high - low) for low, high in ends])), self)
        try:
            for body in fixed:
                world.add_fixed(body, draw.pose(body.root))
            for body, pose in zip(bodies, poses):
                kick = ranges.direction(draw.rng) * ranges.number(draw.rng, self.velocity)
                twist = ranges.direction(draw.rng) * ranges.number(draw.rng, self.spin)
                world.add_falling(body, pose, (kick, twist))
            seconds = None if self.seconds is None else ranges.number(draw.rng, self.seconds)
            world.run(seconds)
            draw.place([body.root for body in bodies], world.poses())
        finally:
            world.close()


class _World:
    """A PyBullet world; lengths in it are metres over `size`."""

    def __init__(self, size: float, contact: Settle) -> None:
        self.size, self.contact = size, contact
        self.bullet = needed("pybullet", "settle needs", "physics")
        self.client = self.bullet.connect(self.bullet.DIRECT)
        self.call(
            "setPhysicsEngineParameter",
            fixedTimeStep=1 / _STEPS,
            numSolverIterations=50,
            deterministicOverlappingPairs=1,
        )
        # Gravity has the same number there, so a second is this many of ours.
        self.slower = math.sqrt(size)
        self.call("setGravity", 0, 0, -_GRAVITY)
        self._falling: list[tuple[int, NdArray, NdArray]] = []

    def call(self, name: str, *arguments: Any, **options: Any) -> Any:
        """A function of PyBullet, in this world."""
        return getattr(self.bullet, name)(*arguments, physicsClientId=self.client, **options)

    def close(self) -> None:
        self.call("disconnect")

    def _finish(self, body: int) -> None:
        self.call(
            "changeDynamics",
            body,
            -1,
            # PyBullet multiplies both bodies' values for a contact: each gets the square root.
            lateralFriction=math.sqrt(self.contact.friction),
            restitution=math.sqrt(self.contact.restitution),
            rollingFriction=0.002,
            linearDamping=0.0,
            spinningFriction=0.002,
        )

    def add_fixed(self, body: Body, pose: NdArray) -> None:
        shape = self.call(
            "createCollisionShape",
            self.bullet.GEOM_MESH,
            vertices=(body.world(pose) / self.size).tolist(),
            indices=body.triangles.ravel().tolist(),
            flags=self.bullet.GEOM_FORCE_CONCAVE_TRIMESH,
        )
        self._finish(self.call("createMultiBody", 0, shape))

    def add_falling(self, body: Body, pose: NdArray, motion: tuple[NdArray, NdArray]) -> None:
        points = extremes(body.positions @ pose[:3, :3].T / self.size)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        shape = self.call(
            "createCollisionShape", self.bullet.GEOM_MESH, vertices=(points - middle).tolist()
        )
        start = pose[:3, 3] / self.size + middle
        made = self.call("createMultiBody", 1.0, shape, basePosition=start.tolist())
        self._finish(made)
        kick, twist = motion[0] * self.slower / self.size, motion[1] * self.slower
        self.call("resetBaseVelocity", made, kick.tolist(), twist.tolist())
        self._falling.append((made, pose, middle))

    def run(self, seconds: float | None) -> None:
        """seconds None: until all rest."""
        limit = _PATIENCE if seconds is None else seconds / self.slower
        for step in range(round(limit * _STEPS)):
            self.call("stepSimulation")
            if seconds is None and step % 24 == 23 and self._rest():
                return

    def _rest(self) -> bool:
        for made, _, _ in self._falling:
            linear, angular = self.call("getBaseVelocity", made)
            if max(map(abs, (*linear, *angular))) > 0.02:
                return False
        return True

    def poses(self) -> list[NdArray]:
        """World poses of the things that fell, in metres."""
        out = []
        for made, pose, middle in self._falling:
            position, xyzw = self.call("getBasePositionAndOrientation", made)
            turn = np.array(self.bullet.getMatrixFromQuaternion(xyzw)).reshape(3, 3)
            now = np.eye(4)
            now[:3, :3] = turn @ pose[:3, :3]
            now[:3, 3] = self.size * (np.array(position) - turn @ middle)
            out.append(now)
        return out


def extremes(points: NdArray) -> NdArray:
    """The points that are farthest in one of 400 directions spread evenly over the sphere: corners
    of the convex hull, few enough for PyBullet. A ball's hull loses 0.3 % of its radius."""
    i = np.arange(_DIRECTIONS) + 0.5
    z, phi = 1 - 2 * i / _DIRECTIONS, i * math.pi * (3 - math.sqrt(5))
    ring = np.sqrt(1 - z * z)
    ways = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], axis=-1)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    return np.asarray(points[np.unique((np.concatenate([axes, ways]) @ points.T).argmax(axis=1))])
