"""Scenes that are exported and read back, and GLB files taken apart, of test_export_*.py."""

import json
import struct
import warnings

import heliograph as hg
import numpy as np

_DTYPES = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
EYE = hg.look_at((0, -5, 2.5), (0, 0, 0.3))


def export(scene, path):
    """Writes the file; the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.export(path)
    assert all(w.category is hg.FileWarning and w.filename == __file__ for w in caught)
    return [str(w.message) for w in caught]


class Glb:
    """A GLB file: its JSON, and its accessors as arrays. Checks what the specification demands."""

    def __init__(self, path):
        data = path.read_bytes()
        assert struct.unpack_from("<4sII", data) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON" and size % 4 == 0
        self.json = json.loads(data[20 : 20 + size])
        binary, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0" and binary % 4 == 0
        self.data = data[28 + size :]
        assert self.json["buffers"] == [{"byteLength": len(self.data)}]

    def view(self, index):
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        assert start % 4 == 0 and start + view["byteLength"] <= len(self.data)
        return self.data[start : start + view["byteLength"]]

    def array(self, index):
        accessor = self.json["accessors"][index]
        width = _WIDTHS[accessor["type"]]
        found = np.frombuffer(self.view(accessor["bufferView"]), _DTYPES[accessor["componentType"]])
        assert found.size == accessor["count"] * width
        found = found.reshape(-1, width) if width > 1 else found
        if "min" in accessor:
            rows = found.reshape(accessor["count"], width)
            np.testing.assert_array_equal(rows.min(0), np.array(accessor["min"], "f4"))
            np.testing.assert_array_equal(rows.max(0), np.array(accessor["max"], "f4"))
        return found

    def node(self, name):
        """The index of the node with that name."""
        (found,) = (i for i, n in enumerate(self.json["nodes"]) if n.get("name") == name)
        return found

    def material(self, name):
        (found,) = (m for m in self.json["materials"] if m["name"] == name)
        return found

    def worlds(self):
        """(4, 4) of each node, in the file's frame."""
        found = {}

        def walk(index, above):
            node = self.json["nodes"][index]
            found[index] = above @ local_of(node)
            for child in node.get("children", []):
                walk(child, found[index])

        for root in self.json["scenes"][self.json["scene"]]["nodes"]:
            walk(root, np.eye(4))
        return found

    def check(self):
        """Checks all meshes' indices, unit normals and tangents, and that references hold."""
        assert set(self.json.get("extensionsUsed", [])) == extensions_in(self.json)
        for mesh in self.json.get("meshes", []):
            for primitive in mesh["primitives"]:
                self._check(primitive)
        for texture in self.json.get("textures", []):
            image = self.json["images"][texture["source"]]
            assert self.view(image["bufferView"]).startswith(b"\x89PNG")
        parents = [c for node in self.json["nodes"] for c in node.get("children", [])]
        assert len(parents) == len(set(parents)) and len(self.worlds()) == len(self.json["nodes"])

    def _check(self, primitive):
        arrays = {k: self.array(v) for k, v in primitive["attributes"].items()}
        assert "min" in self.json["accessors"][primitive["attributes"]["POSITION"]]
        count = len(arrays["POSITION"])
        assert {len(array) for array in arrays.values()} == {count}
        assert self.array(primitive["indices"]).max() < count
        for name in ("NORMAL", "TANGENT"):
            if name in arrays:
                lengths = np.linalg.norm(arrays[name][:, :3].astype("f8"), axis=1)
                np.testing.assert_allclose(lengths, 1, atol=1e-6)
        if "WEIGHTS_0" in arrays:
            np.testing.assert_allclose(arrays["WEIGHTS_0"].sum(1), 1, atol=1e-6)
            assert not arrays["JOINTS_0"][arrays["WEIGHTS_0"] == 0].any()
        assert primitive["material"] < len(self.json["materials"])


def extensions_in(value):
    """Names of all extensions that a document has."""
    found = set()
    if isinstance(value, list):
        return found.union(*map(extensions_in, value))
    if isinstance(value, dict):
        found = set(value.get("extensions", {}))
        return found.union(*map(extensions_in, value.values()))
    return found


def local_of(node):
    """(4, 4) of a node."""
    if "matrix" in node:
        return np.array(node["matrix"], "f8").reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    pose = hg.Pose(node.get("translation", (0, 0, 0)), wxyz=(w, x, y, z)).matrix
    return np.array(pose) @ np.diag([*node.get("scale", (1, 1, 1)), 1])


def furnish(edit):
    """Shapes, shared and not, with parts, a shear, a mirror, below one another; seen by "eye"."""
    rng = np.random.default_rng(3)
    ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.4, 24))
    cube = hg.shapes.cube(0.6)
    parts = np.array([0, 1, 2, 1, 2, 0, 0, 1, 2, 2, 1, 0], "u4")
    colors = rng.random((len(cube["positions"]), 3)).astype("f4")
    box = edit.mesh("box/mesh", **cube, parts=parts, part_names=["a", "b", "c"], colors=colors)
    red, dull = edit.material("red", base_color=(0.8, 0.1, 0.1)), edit.material("dull")
    group = edit.entity("group", transform=hg.Pose((0.2, 0.3, 0), euler=(0, 0, 0.4)))
    edit.entity("ball/0", mesh=ball, material=red, category="ball",
                transform=hg.Pose((-1, 0, 0.4)))  # fmt: skip
    sheared = np.array([[1, 0.3, 0, 1], [0, 0.7, 0.2, 0.2], [0, 0, 1.1, 0.5], [0, 0, 0, 1.0]])
    edit.entity("ball/1", mesh=ball, material=red, parent=group, category="ball",
                transform=sheared)  # fmt: skip
    turned = np.array(hg.Pose((0, 0, 0.5), euler=(0.5, 0.3, 0)).matrix)
    mirrored = turned @ np.diag([-1, 1, 0.8, 1])
    edit.entity("box", mesh=box, materials=[red, dull], transform=mirrored, category="box")
    edit.entity("floor", mesh=edit.mesh("floor/mesh", **hg.shapes.plane(8)), material=dull,
                label=0)  # fmt: skip
    light = hg.Light(radiance=20, shape="disc", radius=0.5)
    edit.entity("lamp", light=light, transform=hg.look_at((1, -1, 4), (0, 0, 0)))
    edit.entity("eye", camera=hg.Camera.from_fov(50, 96, 72, degrees=True), transform=EYE)


def seen(scene, camera, size=(96, 72)):
    """The name of what is seen at each pixel of a picture of that size."""
    lens = scene[camera].camera if isinstance(camera, str) else camera.camera
    x, y = (
        (np.arange(n) + 0.5) * whole / n - 0.5
        for n, whole in zip(size, (lens.width, lens.height), strict=True)
    )
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    found = scene.pick(camera, grid)
    names = {info.id: info.name for info in scene.describe(tree=True).objects}
    return [names.get(int(i), "") for i in found.entity]


def assert_alike(before, after, beauty=0.02):
    """Depth and normals agree to 1e-4 but for outlines; colours in the mean."""
    for name in ("depth", "normal", "base_color"):
        a, b = (np.nan_to_num(frame[name].astype("f8"), posinf=0) for frame in (before, after))
        off = np.abs(a - b) > 1e-4 * max(1, a.max())
        assert off.mean() < 2e-3, name
    a, b = (frame["beauty"].astype("f8")[..., :3] for frame in (before, after))
    assert abs(a.mean() - b.mean()) < beauty * a.mean()
