"""A small generated glTF with a skin, morph targets and clips: imported, animated, against
arithmetic."""

from __future__ import annotations

import base64
import json

import heliograph as hg
import numpy as np
import pytest
from oracle import extent, pixel_rays, pose, rotation, trace
from oracle_motion import HEIGHT, WIDTH, K, Shape, between, grid, project

Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
TURN = 1.2  # radians that the upper joint turns about +X in a second


class Model:
    """A banner in the plane z = 0 of glTF, two joints in it, and one morph target."""

    def __init__(self) -> None:
        points, self.faces = grid(4)
        self.points = np.column_stack([points[:, 0], points[:, 2], points[:, 1]])  # +Y up
        upper = np.clip(0.5 + self.points[:, 1], 0, 1)
        self.weights = np.column_stack([1 - upper, upper, 0 * upper, 0 * upper])
        self.target = np.column_stack([0.4 * self.points[:, 0], 0 * upper, 0 * upper])

    def write(self, path) -> None:
        """The .gltf, its buffer within."""
        data, views, accessors = b"", [], []

        def add(array, dtype, kind, bounds=False):
            nonlocal data
            array = np.ascontiguousarray(array, dtype)
            views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
            data += array.tobytes() + bytes(-array.nbytes % 4)
            component = {"<f4": 5126, "<u2": 5123, "<u4": 5125}[dtype]
            accessor = {"bufferView": len(views) - 1, "componentType": component, "type": kind}
            accessor["count"] = array.size // {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
            if bounds:
                rows = array.reshape(accessor["count"], -1)
                accessor["min"], accessor["max"] = rows.min(0).tolist(), rows.max(0).tolist()
            accessors.append(accessor)
            return len(accessors) - 1

        primitive = {
            "attributes": {
                "POSITION": add(self.points, "<f4", "VEC3", True),
                "JOINTS_0": add(np.tile([0, 1, 0, 0], (len(self.points), 1)), "<u2", "VEC4"),
                "WEIGHTS_0": add(self.weights, "<f4", "VEC4"),
            },
            "indices": add(self.faces, "<u4", "SCALAR"),
            "targets": [{"POSITION": add(self.target, "<f4", "VEC3", True)}],
        }
        binds = np.stack([np.eye(4), np.eye(4)])
        times = add([0, 1], "<f4", "SCALAR", True)
        half = TURN / 2
        turns = [[0, 0, 0, 1], [np.sin(half), 0, 0, np.cos(half)]]
        turn = {"input": times, "output": add(turns, "<f4", "VEC4")}
        morph = {"input": times, "output": add([0, 1], "<f4", "SCALAR")}
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0, 1]}],
            "nodes": [
                {"name": "banner", "mesh": 0, "skin": 0, "translation": [9, 9, 9]},
                {"name": "lower", "children": [2], "translation": [0.2, 0, 0]},
                {"name": "upper"},
            ],
            "meshes": [{"name": "sheet", "primitives": [primitive], "weights": [0.25]}],
            "skins": [{"joints": [1, 2], "inverseBindMatrices": add(binds, "<f4", "MAT4")}],
            "animations": [
                {
                    "name": "rest",
                    "samplers": [morph],
                    "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                },
                {
                    "name": "bow",
                    "samplers": [turn, morph],
                    "channels": [
                        {"sampler": 0, "target": {"node": 2, "path": "rotation"}},
                        {"sampler": 1, "target": {"node": 0, "path": "weights"}},
                    ],
                },
            ],
            "bufferViews": views,
            "accessors": accessors,
        }
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        document["buffers"] = [{"byteLength": len(data), "uri": uri}]
        path.write_text(json.dumps(document))

    def shape(self, root: np.ndarray, turn: float, weight: float) -> Shape:
        """In the world: joints turn, then the model stands up and goes where its root is."""
        lower = pose((0.2, 0, 0))
        joints = np.stack([lower, lower @ pose(r=rotation((1, 0, 0), turn))])
        points = self.points + weight * self.target
        blend = np.tensordot(self.weights[:, :2], joints, 1)
        points = np.einsum("vij,vj->vi", blend[:, :3, :3], points) + blend[:, :3, 3]
        return Shape(points, self.faces, root @ Z_UP, label=1, rest=self.points)


@pytest.fixture
def model(tmp_path):
    made = Model()
    made.write(tmp_path / "banner.gltf")
    made.path = tmp_path / "banner.gltf"
    return made


ROOT = pose((0.1, 0.2, 0.8), rotation((0, 0, 1), 0.4), 1.5)
CAMERA = hg.look_at((0, -5, 1.5), (0, 0, 1))


def build(scene, model, **options):
    with scene.edit() as edit:
        asset = edit.import_file(model.path, transform=ROOT, **options)
        camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
        edit.entity("cam", camera=camera, keys={0: CAMERA, 1: CAMERA})
    return asset


def check(frame, shape, moved=None) -> None:
    camera = np.diag([1.0, -1, -1, 1]) @ np.linalg.inv(CAMERA)
    directions = pixel_rays(K, WIDTH, HEIGHT).reshape(-1, 3) @ camera[:3, :3]
    eye = -camera[:3, :3].T @ camera[:3, 3]
    hits = trace([shape], eye, directions)
    sure = (hits.thing >= 0) & (hits.margin > 4e-3)
    assert sure.sum() > 400
    flat = {name: np.asarray(frame[name], float).reshape(len(sure), -1) for name in frame}
    np.testing.assert_allclose(flat["depth"][sure, 0], hits.t[sure], rtol=5e-5)
    position = eye + hits.t[:, None] * directions
    np.testing.assert_allclose(flat["position"][sure], position[sure], atol=3e-4)
    assert list(frame.labels["bbox_visible"][0]) == extent(frame["instance"] == 1)
    assert (frame["instance"] == 1).sum() == pytest.approx((hits.thing >= 0).sum(), abs=3)
    if moved is None:
        return
    corner = moved.world_positions()[shape.triangles[hits.triangle[sure]]]
    u, v = hits.u[sure, None], hits.v[sure, None]
    there = corner[:, 0] * (1 - u - v) + corner[:, 1] * u + corner[:, 2] * v
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    expected = project(camera, there) - pixels[sure]
    assert np.abs(expected).max() > 0.5
    np.testing.assert_allclose(flat["flow_forward"][sure], expected, atol=0.02)
    np.testing.assert_allclose(flat["scene_flow"][sure], there - position[sure], atol=3e-4)


PLANES = ["depth", "position", "instance"]


def test_without_a_clip_the_model_rests(scene, model):
    """No clip is bound unless one is asked for; the file's own morph weights hold."""
    assert build(scene, model).animations == ["rest", "bow"]
    for t in (0.0, 0.7):
        frame = scene.render("cam", planes=PLANES, time=t)
        check(frame, model.shape(ROOT, 0.0, 0.25))
    # The box of the rest shape lies where the bind pose does, whatever the mesh's own node says.
    rest = 1.5 * (model.points + (0.2, 0, 0)) @ Z_UP[:3, :3].T
    low, high = rest.min(0), rest.max(0)
    labels = frame.labels
    np.testing.assert_allclose(labels["box_center"][0], (low + high) / 2, atol=1e-5)
    np.testing.assert_allclose(labels["box_half_extents"][0], (high - low) / 2, atol=1e-5)


@pytest.mark.parametrize("t", [-0.5, 0.0, 0.3, 0.75])
def test_a_clip_moves_joints_and_morph_targets(scene, model, t):
    build(scene, model, animation="bow")
    planes = [*PLANES, "flow_forward", "scene_flow"]
    frame = scene.render("cam", planes=planes, time=t, frame_interval=0.6)

    def shape(time):
        u = float(between(time, (0.0, 1.0), (0.0, 1.0)))
        return model.shape(ROOT, TURN * u, u)

    check(frame, shape(t), shape(t + 0.6))


def test_the_first_clip_can_be_bound_by_its_index(scene, model):
    build(scene, model, animation=0)
    check(scene.render("cam", planes=PLANES, time=1.0), model.shape(ROOT, 0.0, 1.0))


def test_a_loaded_scene_shares_the_model_again(client, scene, model, tmp_path):
    build(scene, model, animation="bow")
    frame = scene.render("cam", planes=PLANES, time=0.4)
    scene.save(tmp_path / "x.helio")
    with client.load_scene(tmp_path / "x.helio") as loaded:
        again = loaded.render("cam", planes=PLANES, time=0.4)
        for name in PLANES:
            assert frame[name].tobytes() == again[name].tobytes()
        with loaded.edit() as edit:
            copy = edit.import_file(model.path, name="copy", transform=pose((9, 0, 0)))
        assert not loaded.find("*~2")
        assert loaded.describe().counts.meshes == 1
        assert [m.id for m in copy.meshes.values()] == [loaded["banner/sheet"].id]
