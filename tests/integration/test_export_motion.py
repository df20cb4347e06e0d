"""Motion in exported files: keys, morph targets, keys of vertices and skins, where they are at
times between the keys."""

import math

import exported
import heliograph as hg
import numpy as np
import pytest

TIMES = np.array([0.0, 0.3, 0.5, 0.9, 1.0, 1.4, 2.0])
ENDINGS = ["glb", "usdz"]


def again(client, path):
    """A fresh scene with the file and its motion, and entities by the names that they had."""
    if path.suffix == ".usdz":
        pytest.importorskip("pxr", reason="the extra `usd` is not installed")
    scene = client.create_scene()
    with scene.edit() as edit:
        if path.suffix == ".usdz":
            asset = edit.import_usd(path, times="all")
            found = {key.rpartition("/")[2]: one for key, one in asset.entities.items()}
        else:
            asset = edit.import_file(path, animation="motion")
            found = {one.name.rpartition("/")[2]: one for one in asset.entities}
        edit.entity("eye", camera=hg.Camera.from_fov(1.0, 8, 8), transform=exported.EYE)
    assert asset.warnings == []
    return scene, found


def vertices_at(scene, entity, times):
    """(T, V, 3) in the world."""
    count = int(entity.mesh.indices.max()) + 1
    return scene.tracks("eye", (entity, np.arange(count)), times).position.swapaxes(0, 1)


def shown(scene, name):
    """The entity that shows a mesh and has that name, or lies below one that has."""
    ends = f"/{name}", f"/{name}/mesh", f"/{name}/mesh/mesh"
    (found,) = (one for one in scene.find("*") if isinstance(one, hg.Entity) and one.mesh
                and one.name.endswith(ends))  # fmt: skip
    return found


def assert_same_places(found, expected, within=2e-4):
    """Each place of one is a place of the other; files may order and split vertices."""
    for one, other in zip(found, expected, strict=True):
        apart = np.linalg.norm(one[:, None] - other[None], axis=-1)
        assert apart.min(0).max() < within and apart.min(1).max() < within


def eyed(scene):
    with scene.edit() as edit:
        edit.entity("eye", camera=hg.Camera.from_fov(60, 8, 8, degrees=True),
                    transform=exported.EYE)  # fmt: skip


@pytest.mark.parametrize("ending", ENDINGS)
def test_keys_of_poses_and_what_hangs_from_them(client, scene, tmp_path, ending):
    eyed(scene)
    turn = {t: hg.Pose((t, 0, 0.2 * t), euler=(0, 0, 1.2 * t), scale=1 + t) for t in (0, 1, 2)}
    tip = {t: hg.Pose((0, 1, 0), euler=(0.9 * math.sin(t), 0, 0)) for t in (0.5, 1.5)}
    with scene.edit() as edit:
        mesh = edit.mesh("m", **hg.shapes.cube(0.5))
        edit.entity("arm", mesh=mesh, keys=turn)
        edit.entity("hand", mesh=mesh, parent="arm", keys=tip)
    path = tmp_path / f"scene.{ending}"
    assert exported.export(scene, path) == []
    back, found = again(client, path)
    with back:
        for name in ("arm", "hand"):
            own = vertices_at(scene, scene[name], TIMES)
            entity = shown(back, name)
            assert_same_places(vertices_at(back, entity, TIMES), own)


@pytest.mark.parametrize("ending", ENDINGS)
def test_morph_targets_and_keys_of_vertices(client, scene, tmp_path, ending):
    eyed(scene)
    rng = np.random.default_rng(0)
    shape = hg.shapes.torus(0.4, 0.1, 12)
    rest = np.asarray(shape["positions"])
    moved = np.stack([rest, rest * (1, 1, 0.5), rest + (0.5, 0, 0)])
    targets = rng.normal(0, 0.1, (2, *rest.shape)).astype("f4")
    with scene.edit() as edit:
        shape.pop("normals")
        soft = edit.mesh("soft", **{**shape, "positions": moved, "times": [0.0, 1.0, 1.6]})
        edit.entity("soft", mesh=soft)
        face = edit.mesh("face", **shape, morph_positions=targets)
        edit.entity("face", mesh=face, morph_weights={0.0: (0, 1), 1.2: (1, 0.5), 2.0: (0, 0)})
        edit.entity("still", mesh=face, morph_weights=(0.25, 0.75), transform=hg.Pose((2, 0, 0)))
    path = tmp_path / f"scene.{ending}"
    assert exported.export(scene, path) == []
    back, found = again(client, path)
    with back:
        for name in ("soft", "face", "still"):
            own = vertices_at(scene, scene[name], TIMES)
            assert_same_places(vertices_at(back, shown(back, name), TIMES), own)


@pytest.mark.parametrize("ending", ENDINGS)
def test_skins_follow_their_joints(client, scene, tmp_path, ending):
    eyed(scene)
    shape = hg.shapes.cylinder(0.2, 2.0, 12)
    height = np.asarray(shape["positions"])[:, 2]
    share = np.clip(height / 2 + 0.5, 0, 1)
    joints = np.tile(np.array([0, 1, 1, 0], "u2"), (len(share), 1))  # each joint twice
    weights = np.column_stack([1 - share, share / 2, share / 2, 0 * share]).astype("f4")
    with scene.edit() as edit:
        mesh = edit.mesh("arm/mesh", **shape, joints=joints, weights=weights)
        edit.entity("frame", transform=hg.Pose((0.5, 0, 0), euler=(0, 0, 0.3)))
        edit.entity("low", parent="frame", transform=hg.Pose((0, 0, -1)))
        bend = {0.0: hg.Pose((0, 0, 1)), 1.0: hg.Pose((0, 0, 1), euler=(0.8, 0, 0))}
        edit.entity("high", parent="low", keys=bend)
        binds = np.stack([np.array(hg.Pose((0, 0, z)).matrix) for z in (1, 0)])
        edit.entity("arm", mesh=mesh, skin=(["low", "high"], binds), transform=hg.Pose((9, 9, 9)))
    path = tmp_path / f"scene.{ending}"
    assert exported.export(scene, path) == []
    own = vertices_at(scene, scene["arm"], TIMES)
    assert np.ptp(own[4] - own[0]) > 0.5  # it bends
    back, found = again(client, path)
    with back:
        skin = shown(back, "arm.skin" if ending == "glb" else "arm")
        assert_same_places(vertices_at(back, skin, TIMES), own, 2e-3)


def test_keys_before_0_are_moved(scene, tmp_path):
    with scene.edit() as edit:
        keys = {-1.5: hg.Pose(), 0.5: hg.Pose((1, 0, 0))}
        edit.entity("it", mesh=edit.mesh("m", **hg.shapes.cube()), keys=keys)
    path = tmp_path / "scene.glb"
    (note,) = exported.export(scene, path)
    assert "1.5 s are added to all keys" in note
    glb = exported.Glb(path)
    glb.check()
    (clip,) = glb.json["animations"]
    (sampler,) = clip["samplers"]  # it does not turn
    np.testing.assert_array_equal(glb.array(sampler["input"]), [0, 2])
    node = glb.json["nodes"][glb.node("it")]
    np.testing.assert_allclose(node["translation"], [0.75, 0, 0])  # at the scene's time, 0


def test_a_moving_shear_is_named(scene, tmp_path):
    sheared = np.array([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    with scene.edit() as edit:
        edit.entity("it", keys={0.0: sheared, 1.0: np.eye(4)})
    (note,) = exported.export(scene, tmp_path / "scene.glb")
    assert "it: the shear of a pose that moves is left out" in note
