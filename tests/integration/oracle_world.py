"""The scene of the oracle, moved once by advance(), and what each of its pixels should show."""

from __future__ import annotations

import heliograph as hg
import numpy as np
from oracle import (
    CV_FROM_GL,
    Thing,
    at_hits,
    cube,
    facing_normals,
    icosphere,
    look_at_cv,
    pixel_rays,
    pose,
    rotation,
    trace,
)

WIDTH, HEIGHT = 96, 64
K = np.array([[88.0, 0, 43.7], [0, 101.0, 35.2], [0, 0, 1]])
PLANES = """
    depth distance position position_camera normal normal_camera geometric_normal uv
    barycentric base_color roughness metallic instance semantic part material primitive
    object_coordinates nocs flow_forward flow_backward flow_forward_valid flow_backward_valid
    flow_forward_visible flow_backward_visible scene_flow
""".split()
DT = 0.1


class World:
    """A plane, a squashed turning sphere, a box with a lid as its child; moved once."""

    def __init__(self, client: hg.Client) -> None:
        points, faces = icosphere(2)
        sphere_uv = np.stack([np.arctan2(points[:, 1], points[:, 0]), points[:, 2]], -1)
        quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
        quad_uv = quad[:, :2] * 0.5 + 0.5
        quad_faces = np.array([[0, 1, 2], [0, 2, 3]])
        corners, box_faces, box_parts = cube()

        self.eye, self.target = (
            [(0.2, -5.0, 2.6), (0.25, -4.9, 2.6)],
            [(0, 0, 0.6), (0.05, 0, 0.62)],
        )
        squash = (0.9, 0.5, 0.7)
        sphere = [
            pose((-0.9, 0.1, 0.8), rotation((0, 0, 1), 0.3), squash),
            pose((-0.8, 0.0, 0.85), rotation((0.2, 0, 1), 0.5), squash),
        ]
        box = [
            pose((0.9, 0.2, 0.5), rotation((0, 0, 1), 0.4), 0.4),
            pose((0.8, 0.15, 0.5), rotation((0, 0, 1), 0.6), 0.4),
        ]
        lid = pose((0, 0, 1.3), rotation((0, 0, 1), 0.2), (1.2, 1.2, 0.1))
        floor = pose(scale=4.0)
        self.states = [
            [
                Thing(quad, quad_faces, floor, None, quad_uv, None, 7, 1),
                Thing(points, faces, sphere[k], points, sphere_uv, None, 3, 2),
                Thing(corners, box_faces, box[k], None, None, box_parts, 5, 3),
                Thing(corners, box_faces, box[k] @ lid, None, None, box_parts, 5, 3, first_part=3),
            ]
            for k in range(2)
        ]
        self.scene = client.create_scene()
        with self.scene.edit() as edit:
            meshes = [
                edit.mesh("quad", positions=quad, indices=quad_faces, uvs=quad_uv),
                edit.mesh("sphere", positions=points, indices=faces, normals=points, uvs=sphere_uv),
                edit.mesh("box", positions=corners, indices=box_faces, parts=box_parts),
            ]
            grey = edit.material("grey", base_color=(0.5, 0.4, 0.3), roughness=0.25)
            steel = edit.material("steel", base_color=(0.7, 0.7, 0.6), metallic=1, roughness=0.125)
            edit.entity(
                "floor", mesh=meshes[0], material=grey, transform=floor, label=7, category="ground"
            )
            edit.entity(
                "ball",
                mesh=meshes[1],
                material=steel,
                transform=sphere[0],
                label=3,
                category="ball",
            )
            edit.entity(
                "crate",
                mesh=meshes[2],
                materials=[grey, steel],
                transform=box[0],
                label=5,
                category="crate",
            )
            edit.entity(
                "lid", parent="crate", mesh=meshes[2], materials=[steel, grey], transform=lid
            )
            camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
            edit.entity("cam", camera=camera, transform=self.world_from_camera(0))
            edit.dome(color=(1, 1, 1))
        with self.scene.edit() as edit:
            edit.advance(DT)
            edit.entity("ball", transform=sphere[1])
            edit.entity("crate", transform=box[1])
            edit.entity("cam", transform=self.world_from_camera(1))
        # At the new time only backward flow is defined; at the old time only forward flow.
        self.frames = [
            self.scene.render(
                "cam", planes=[p for p in PLANES if "backward" not in p], time=0, frame_interval=DT
            ),
            self.scene.render(
                "cam",
                planes=[p for p in PLANES if "forward" not in p and p != "scene_flow"],
                labels=["boxes", "amodal", "amodal_masks"],
            ),
        ]

    def world_from_camera(self, k: int) -> np.ndarray:
        return np.linalg.inv(look_at_cv(self.eye[k], self.target[k])) @ CV_FROM_GL

    def camera_from_world(self, k: int) -> np.ndarray:
        return look_at_cv(self.eye[k], self.target[k])


class Truth:
    """Expected value of every pixel in one state."""

    def __init__(self, world: World, k: int) -> None:
        self.things = world.states[k]
        self.camera = world.camera_from_world(k)
        rays = pixel_rays(K, WIDTH, HEIGHT).reshape(-1, 3)
        r, t = self.camera[:3, :3], self.camera[:3, 3]
        self.origin = -r.T @ t
        self.directions = rays @ r
        self.hits = trace(self.things, self.origin, self.directions)
        self.hit = self.hits.thing >= 0
        self.sure = self.hit & (
            self.hits.margin > 2e-3
        )  # not on an edge, where either side is right
        reach = np.where(self.hit, self.hits.t, 0)
        self.position = self.origin + reach[:, None] * self.directions

    def corner_values(self, name: str, size: int) -> np.ndarray:
        """An attribute interpolated at the hits, (N, size); zeros where it is absent."""
        out = np.zeros((len(self.hit), size))
        for index, thing in enumerate(self.things):
            values = getattr(thing, name)
            if values is None:
                continue
            mine, there = at_hits(self.hits, index, thing, values)
            out[mine] = there
        return out

    def per_thing(self, values: list) -> np.ndarray:
        return np.array([*values, 0])[self.hits.thing]

    def geometric_normals(self) -> np.ndarray:
        return facing_normals(self.hits, self.things, self.directions)


def project(camera_from_world: np.ndarray, p: np.ndarray) -> np.ndarray:
    q = p @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    return q[:, :2] / q[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
