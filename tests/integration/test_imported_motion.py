"""A small generated glTF with a skin, morph targets and clips: imported, animated, against
arithmetic."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from banner import ROOT, TURN, Z_UP, Banner, build, check
from oracle import pose
from oracle_motion import between


class Model(Banner):
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


@pytest.fixture
def model(tmp_path):
    made = Model()
    made.write(tmp_path / "banner.gltf")
    made.path = tmp_path / "banner.gltf"
    return made


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
