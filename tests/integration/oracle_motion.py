"""Scenes whose surfaces change shape, and where each of their points is at any time. Arithmetic in
numpy float64 that shares no code with the renderer; used by test_motion_oracle.py."""

from __future__ import annotations

from dataclasses import dataclass, field

import heliograph as hg
import numpy as np
from oracle import CV_FROM_GL, Thing, cube, icosphere, look_at_cv, pose, rotation

WIDTH, HEIGHT = 120, 72
K = np.array([[110.0, 0, 58.2], [0, 116.0, 37.4], [0, 0, 1]])


@dataclass
class Shape(Thing):
    """A Thing at one instant, with its vertices at rest."""

    rest: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def normals_in_world(self) -> np.ndarray:
        out = self.normals @ np.linalg.inv(self.world[:3, :3])
        return out / np.linalg.norm(out, axis=1, keepdims=True)


def between(time: float, times, values):
    """Linear between keys, held outside."""
    values = np.asarray(values, float)
    i = int(np.clip(np.searchsorted(times, time) - 1, 0, len(times) - 2))
    u = np.clip((time - times[i]) / (times[i + 1] - times[i]), 0, 1)
    return values[i] * (1 - u) + values[i + 1] * u


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A sheet in the plane y = 0 that faces -y, side 1.4, of n x n quads."""
    s = np.linspace(-0.7, 0.7, n + 1)
    points = np.array([[x, 0, z] for z in s for x in s])
    quads = [(j * (n + 1) + i, j * (n + 1) + i + 1) for j in range(n) for i in range(n)]
    return points, np.array(
        [t for a, b in quads for t in ((a, b, b + n + 1), (a, b + n + 1, a + n + 1))]
    )


class Cloth:
    """Keyed vertices under a pose that mirrors and shears; flat normals."""

    label = 1
    times = (0.0, 1.0, 3.0)

    def __init__(self) -> None:
        self.rest, self.faces = grid(5)
        x, _, z = self.rest.T
        bend = [0 * x, 0.3 * np.sin(3 * x), 0.3 * np.cos(4 * z) + 0.1 * x]
        self.keys = np.array([self.rest + np.stack([0 * b, b, 0.2 * b], 1) for b in bend])
        self.world = pose((-2.5, 0.3, 1.2), rotation((0, 0, 1), 0.2), (-1, 1.1, 0.9))
        self.world[:3, 0] += 0.3 * self.world[:3, 2]

    def build(self, edit: hg.Edits) -> None:
        mesh = edit.mesh("cloth", positions=self.keys, times=self.times, indices=self.faces)
        edit.entity("cloth/entity", mesh=mesh, transform=self.world, label=self.label, static=True)

    def at(self, t: float) -> Shape:
        now = between(t, self.times, self.keys)
        return Shape(now, self.faces, self.world, label=self.label, rest=self.keys[0])


class Face:
    """Morph targets with keyed weights; smooth normals that have targets too."""

    label = 2
    times, weights = (0.0, 1.0, 2.0), ((0.0, 0.0), (1.0, 0.5), (-0.25, 1.0))

    def __init__(self) -> None:
        self.points, self.faces = icosphere(1)
        x, y, z = self.points.T
        self.targets = np.stack([np.stack([0.5 * x, 0 * y, -0.4 * z], 1), self.points * 0.3])
        self.normal_targets = np.stack([np.stack([-0.3 * x, 0 * y, 0.5 * z], 1), 0 * self.points])
        self.world = pose((-0.7, 0, 1.2), rotation((1, 0, 0), 0.4), (0.55, 0.5, 0.6))

    def build(self, edit: hg.Edits) -> None:
        mesh = edit.mesh(
            "face",
            positions=self.points,
            normals=self.points,
            indices=self.faces,
            morph_positions=self.targets,
            morph_normals=self.normal_targets,
        )
        weights = dict(zip(self.times, self.weights, strict=True))
        edit.entity(
            "face/entity",
            mesh=mesh,
            transform=self.world,
            label=self.label,
            morph_weights=weights,
        )

    def shape(self, weights) -> Shape:
        points = self.points + np.tensordot(weights, self.targets, 1)
        normals = self.points + np.tensordot(weights, self.normal_targets, 1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Shape(points, self.faces, self.world, normals, label=self.label, rest=self.points)

    def at(self, t: float) -> Shape:
        return self.shape(between(t, self.times, self.weights))


class Arm:
    """A bar skinned to an upper and a lower joint, each turned by keys; smooth normals."""

    label = 3

    def __init__(self) -> None:
        corners, faces, _ = cube()
        rows = np.linspace(-1, 1, 7)
        ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        self.points = np.array([(0.2 * x, 0.2 * y, 0.7 * z) for z in rows for x, y in ring])
        self.faces = np.array(
            [
                t
                for k in range(6)
                for i in range(4)
                for a, b in [(4 * k + i, 4 * k + (i + 1) % 4)]
                for t in ((a, b, b + 4), (a, b + 4, a + 4))
            ]
        )
        self.normals = np.tile(np.column_stack([ring, 0 * ring[:, 0]]) / 2**0.5, (7, 1))
        upper = np.clip(0.5 + self.points[:, 2], 0, 1)
        self.weights = np.column_stack([1 - upper, upper, 0 * upper, 0 * upper])
        self.world = pose((0.4, 0.5, 0.9), rotation((0, 0, 1), 0.7), 1.3)
        self.base = pose((0.9, 0, 1.2), rotation((0, 0, 1), 0.3))
        self.binds = np.stack([np.eye(4), pose((0, 0, -0.1))])

    def joints(self, t: float) -> list[np.ndarray]:
        turn = between(t, (0.0, 1.0), (0.0, 1.0))
        hip = self.base @ pose((0, 0, 0.2 * turn), rotation((0, 1, 0), 0.5 * turn))
        knee = pose((0, 0, 0.1), rotation((1, 0.5, 0), 1.1 * between(t, (0.5, 2.0), (0.0, 1.0))))
        return [hip, hip @ knee]

    def build(self, edit: hg.Edits) -> None:
        mesh = edit.mesh(
            "arm",
            positions=self.points,
            normals=self.normals,
            indices=self.faces,
            joints=np.tile(np.array([0, 1, 0, 0], np.uint16), (len(self.points), 1)),
            weights=self.weights,
        )
        edit.entity("base", transform=self.base)
        to_base = np.linalg.inv(self.base)
        edit.entity("hip", parent="base", keys={t: to_base @ self.joints(t)[0] for t in (0, 1)})
        keys = {t: np.linalg.inv(self.joints(t)[0]) @ self.joints(t)[1] for t in (0.5, 2)}
        edit.entity("knee", parent="hip", keys=keys)
        edit.entity(
            "arm/entity",
            mesh=mesh,
            transform=self.world,
            label=self.label,
            skin=(["hip", "knee"], self.binds),
        )

    def shape(self, joints: list[np.ndarray]) -> Shape:
        """The vertices in world space are the blended joints'; the entity's own pose cancels."""
        maps = np.stack([j @ b for j, b in zip(joints, self.binds, strict=True)])
        blend = np.tensordot(self.weights[:, :2], maps, 1)
        world = np.einsum("vij,vj->vi", blend[:, :3, :3], self.points) + blend[:, :3, 3]
        normals = np.einsum("vji,vj->vi", np.linalg.inv(blend[:, :3, :3]), self.normals)
        # Normals are unit in the entity's frame, where they are interpolated.
        local = normals @ self.world[:3, :3]
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        back = np.linalg.inv(self.world)
        points = world @ back[:3, :3].T + back[:3, 3]
        return Shape(points, self.faces, self.world, local, label=self.label, rest=self.points)

    def at(self, t: float) -> Shape:
        return self.shape(self.joints(t))


class Nested:
    """A cube whose parent, itself and vertices have keys at different times."""

    label = 4

    def __init__(self) -> None:
        self.points, self.faces, _ = cube()
        self.points = self.points * 0.4
        self.keys = np.stack([self.points, self.points * (1.4, 0.6, 1)])

    def parent(self, t: float) -> np.ndarray:
        u = between(t, (0.0, 2.0), (0.0, 1.0))
        return pose((2.4, 0.2 * u, 1 + 0.4 * u), rotation((0, 0, 1), 1.2 * u), 1 + 0.3 * u)

    def child(self, t: float) -> np.ndarray:
        u = between(t, (0.5, 1.5), (0.0, 1.0))
        return pose((0.2 * u, 0, 0), rotation((1, 0, 0), -0.9 * u), (1, 1 + u, 1))

    def build(self, edit: hg.Edits) -> None:
        mesh = edit.mesh("nested", positions=self.keys, times=(0, 1), indices=self.faces)
        edit.entity("parent", keys={t: self.parent(t) for t in (0, 2)})
        keys = {t: self.child(t) for t in (0.5, 1.5)}
        edit.entity("nested/entity", parent="parent", keys=keys, mesh=mesh, label=self.label)

    def at(self, t: float) -> Shape:
        world = self.parent(t) @ self.child(t)
        now = between(t, (0.0, 1.0), self.keys)
        return Shape(now, self.faces, world, label=self.label, rest=self.points)


class Wall:
    """The background; by its keys it does not move."""

    label = 5

    def __init__(self) -> None:
        self.points, self.faces = grid(1)
        self.world = pose((0, 3, 1), scale=(7.0, 1, 4.0))

    def build(self, edit: hg.Edits) -> None:
        mesh = edit.mesh("wall", positions=self.points, indices=self.faces)
        keys = {0: self.world, 1: self.world}
        edit.entity("wall/entity", mesh=mesh, keys=keys, label=self.label, static=True)

    def at(self, t: float) -> Shape:
        return Shape(self.points, self.faces, self.world, label=self.label, rest=self.points)


class Stage:
    """All of them in one scene, seen by a camera that moves without turning."""

    def __init__(self, client: hg.Client, actors: list) -> None:
        self.actors = actors
        self.scene = client.create_scene()
        with self.scene.edit() as edit:
            for actor in actors:
                actor.build(edit)
            camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
            keys = {t: np.linalg.inv(self.camera(t)) @ CV_FROM_GL for t in (0, 2)}
            edit.entity("cam", camera=camera, keys=keys)

    def camera(self, t: float) -> np.ndarray:
        """camera_from_world, OpenCV."""
        move = np.array((0.3, 0.2, 0.1)) * between(t, (0.0, 2.0), (0.0, 1.0))
        return look_at_cv(np.array((0, -7, 1.3)) + move, np.array((0, 0, 1.1)) + move)

    def shapes(self, t: float) -> list[Shape]:
        return [actor.at(t) for actor in self.actors]


def project(camera_from_world: np.ndarray, p: np.ndarray) -> np.ndarray:
    q = p @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    return q[:, :2] / q[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
