"""MJCF files in a real daemon, against MuJoCo itself: poses, rays, colours, cameras."""

import json
import pickle
import sys

import heliograph as hg
import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

ROOT = hg.Pose((0.1, -0.2, 0.05), euler=(0.1, -0.05, 0.4)).matrix
TETRAHEDRON = "0 0 0  0.3 0 0  0 0.3 0  0 0 0.4"
HEIGHTS = "0 0.2 0.1 0.4  0.3 1 0.2 0.1  0 0.5 0.6 0.2"
WORLD = f"""<mujoco model="things">
  <statistic center="0 0 0.5" extent="2"/>
  <asset>
    <mesh name="rock" vertex="{TETRAHEDRON}"/>
    <hfield name="hill" nrow="3" ncol="4" size="0.5 0.4 0.3 0.1" elevation="{HEIGHTS}"/>
    <texture name="chess" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="64"
      height="64"/>
    <material name="tiles" texture="chess" texrepeat="2 3"/>
  </asset>
  <default>
    <default class="leg"><geom type="capsule" size="0.05 0.15" rgba="0.2 0.8 0.2 1"/></default>
  </default>
  <worldbody>
    <light name="lamp" pos="0 0 3"/>
    <geom name="floor" type="plane" size="3 3 0.1" material="tiles"/>
    <geom name="hill" type="hfield" hfield="hill" pos="-1 1 0.2" euler="0 0 20"/>
    <camera name="high" pos="0 -3 2" xyaxes="1 0 0 0 0.5 0.9" fovy="50" resolution="160 120"/>
    <body name="trunk" pos="0 0 0.8">
      <freejoint name="root"/>
      <geom name="belly" type="ellipsoid" size="0.3 0.2 0.1"/>
      <geom name="hull" type="sphere" size="2" group="3"/>
      <camera name="eye" mode="fixed" pos="0.3 0 0.1" xyaxes="0 -1 0 0 0 1"/>
      <camera name="chase" mode="track" pos="0 -2 1"/>
      <body name="leg" pos="0.2 0.1 -0.1" euler="10 20 30">
        <joint name="roll" axis="1 0 0" pos="0 0 0.1" range="-40 40"/>
        <joint name="pitch" axis="0 1 0" pos="0 0 0.1" ref="15" range="-90 90"/>
        <geom class="leg" pos="0 0 -0.1"/>
        <site name="sole" pos="0 0 -0.3"/>
        <body name="foot" pos="0 0 -0.3">
          <joint name="ankle" type="ball"/>
          <geom name="toe" type="cylinder" size="0.08 0.05"/>
          <geom type="mesh" mesh="rock" pos="0.1 0 0"/>
        </body>
      </body>
      <body pos="-0.2 0.1 0">
        <joint name="slot" type="slide" axis="0 1 1" range="0.1 0.5"/>
        <geom name="box" type="box" size="0.1 0.15 0.05" rgba="0.9 0.1 0.1 1"/>
      </body>
    </body>
    <body name="ball" pos="1 0.5 0.3"><geom type="sphere" size="0.3"/></body>
  </worldbody>
  <keyframe>
    <key name="home" qpos="0 0 1 1 0 0 0  0.1 0.2  1 0 0 0  0.3"/>
    <key qpos="0 0 1 0 1 0 0  0 0  0 1 0 0  0.3"/>
  </keyframe>
</mujoco>"""


def simulated(seed=0, model=None):
    """A model and its data in a random configuration."""
    model = model or mujoco.MjModel.from_xml_string(WORLD)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    data.qpos[:] = model.qpos0 + rng.uniform(-0.4, 0.4, model.nq)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture
def stage(scene, tmp_path):
    (tmp_path / "things.xml").write_text(WORLD)
    with scene.edit() as edit:
        robot = edit.import_mjcf(tmp_path / "things.xml", size=(160, 120))
    return robot


def matrices(positions, rotations):
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    out[:, :3, :3], out[:, :3, 3] = rotations.reshape(-1, 3, 3), positions
    return out


def test_bodies_are_where_mujoco_has_them(scene, stage):
    model, data = simulated(1)
    bodies = ["world", "trunk", "leg", "foot", "body4", "ball"]
    places = [stage.link_names.index(name) for name in bodies]
    expected = matrices(data.xpos, data.xmat)
    np.testing.assert_allclose(stage.forward(data.qpos)[places], expected, atol=1e-12)
    with scene.edit() as edit:
        edit.set_joints(stage, data.qpos)
    for name, pose in zip(bodies, expected, strict=True):
        np.testing.assert_allclose(stage.links[name].world_transform, pose, atol=1e-5)
    geoms = matrices(data.geom_xpos, data.geom_xmat)
    for name, entity in stage.geoms.items():
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
        number = number if number >= 0 else int(name.removeprefix("geom"))
        np.testing.assert_allclose(entity.world_transform, geoms[number], atol=1e-5)
    assert "hull" not in stage.geoms and len(stage.geoms) == model.ngeom - 1


def rays(frame):
    """(H, W, 3) unit directions in the world, and where they start."""
    height, width = frame["distance"].shape
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    local = np.concatenate([(at - frame.K[:2, 2]) / frame.K[[0, 1], [0, 1]], at[..., :1] ** 0], -1)
    turn = frame.camera_from_world_cv[:3, :3]
    directions = local @ turn
    origin = -turn.T @ frame.camera_from_world_cv[:3, 3]
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True), origin


def traced(model, data, directions, origin):
    """Distances and geoms by mj_ray of what groups 0 to 2 show; inf and -1 for nothing."""
    distances, geoms = [], []
    groups, found = np.array([1, 1, 1, 0, 0, 0], np.uint8), np.array([-1], np.int32)
    for direction in directions.reshape(-1, 3):
        distance = mujoco.mj_ray(model, data, origin, direction, groups, 1, -1, found)
        distances.append(distance if distance >= 0 else np.inf)
        geoms.append(int(found[0]))
    shape = directions.shape[:2]
    return np.array(distances).reshape(shape), np.array(geoms).reshape(shape)


@pytest.mark.parametrize("seed", range(3))
def test_rays_meet_what_those_of_mujoco_meet(scene, stage, seed):
    model, data = simulated(seed)
    with scene.edit() as edit:
        edit.set_joints(stage, data.qpos)
    camera = stage.cameras["high" if seed else "eye"]
    frame = scene.render(camera, planes=["distance", "part", "instance"], spp=1)
    distance, geoms = traced(model, data, *rays(frame))
    assert len(np.unique(geoms)) > (3 if seed else 1)
    same = np.isclose(frame["distance"], distance, rtol=2e-3, atol=2e-3)
    assert same.mean() > 0.99, (same.mean(), np.argwhere(~same)[:5])
    bodies = np.append(model.geom_bodyid, -1)[geoms]
    names = np.array(["world", "trunk", "leg", "foot", "body4", "ball"])
    seen = stage.link_of(frame["part"])
    links = np.array([stage.link_names.index(name) for name in names])
    assert (seen == np.where(bodies < 0, -1, links[bodies])).mean() > 0.99
    thing = np.select([bodies < 0, bodies == 0, bodies == 5], [-1, geoms, 8], 9)[same]
    pairs = set(zip(thing.tolist(), frame["instance"][same].tolist(), strict=True))
    assert len(pairs) == len(dict(pairs)) == len({instance for _, instance in pairs})


def test_height_fields_are_those_that_rays_meet(scene, stage):
    model, data = simulated()
    lens = hg.Camera.from_fov(40, 96, 72, degrees=True)
    for eye in ((-1, 0.2, 1.5), (-2.2, 1.5, 0.8)):
        with scene.edit() as edit:
            edit.entity("above", camera=lens, transform=hg.look_at(eye, (-1, 1, 0.2)))
        frame = scene.render("above", planes=["distance", "geometric_normal"], spp=1)
        distance, geoms = traced(model, data, *rays(frame))
        hill = geoms == model.geom("hill").id
        assert hill.sum() > 1000
        same = np.isclose(frame["distance"], distance, rtol=1e-4)
        assert same[hill].mean() > 0.995


def test_values_are_qpos(scene, stage):
    model, data = simulated(2)
    assert len(stage.joint_names) == model.nq
    assert stage.joint_names[:7] == [f"root/{c}" for c in "x y z qw qx qy qz".split()]
    assert stage.joint_names[7:] == [
        *("roll", "pitch", "ankle/qw", "ankle/qx", "ankle/qy", "ankle/qz", "slot")
    ]
    np.testing.assert_array_equal(stage.rest, model.qpos0)
    np.testing.assert_allclose(stage.limits[7:9], np.radians([[-40, 40], [-90, 90]]))
    assert list(stage.keyframes) == ["home", "key1"]
    np.testing.assert_array_equal(stage.keyframes["home"], model.key_qpos[0])
    beyond = np.array(model.key_qpos[0])
    beyond[model.joint("slot").qposadr] = 0.7
    place = stage.link_names.index("body4")
    assert stage.forward(beyond)[place, 2, 3] > stage.forward(beyond, clamp=True)[place, 2, 3]
    with scene.edit() as edit:
        edit.set_joints(stage, {"root": data.qpos[:7], "ankle": data.qpos[9:13]})
    data.qpos[[7, 8, 13]] = model.qpos0[[7, 8, 13]]
    mujoco.mj_kinematics(model, data)
    foot = matrices(data.xpos, data.xmat)[3]
    np.testing.assert_allclose(stage.links["foot"].world_transform, foot, atol=1e-5)
    with pytest.raises(hg.InvalidArgument, match=r"'ankle'.*\(qw, qx, qy, qz\)"):
        stage.forward({"ankle": [1, 0, 0]})


def test_cameras_that_track_are_where_mujoco_has_them(scene, stage):
    model, data = simulated(3)
    number = model.camera("chase").id
    expected = matrices(data.cam_xpos, data.cam_xmat)[number]
    np.testing.assert_allclose(stage.camera_pose("chase", data.qpos), expected, atol=1e-9)
    with pytest.raises(hg.InvalidArgument, match="no camera 'nose'; it has high, eye, chase"):
        stage.camera_pose("nose", data.qpos)


def test_worlds_take_the_qpos_of_as_many_simulations(scene, stage):
    qpos = np.array([simulated(seed)[1].qpos for seed in range(3)])
    camera = stage.cameras["high"]
    worlds = hg.Worlds(3).set_joints(stage, qpos)
    batch = scene.render_worlds(camera, worlds, planes=["distance"], spp=1)
    for row, image in zip(qpos, batch["distance"], strict=True):
        with scene.overlay() as overlay:
            overlay.set_joints(stage, row)
        alone = scene.render(camera, overlay=overlay, planes=["distance"], spp=1)
        np.testing.assert_array_equal(image[0], alone["distance"])


def test_a_picture_lies_on_the_floor_as_in_mujoco(scene, stage):
    model, _ = simulated()
    frame = scene.render(stage.cameras["high"], planes=["base_color", "position"], spp=1)
    numbers = np.array(model.tex_data).reshape(64, 64, 3)
    x, y, _ = np.moveaxis(frame["position"], -1, 0)
    s, t = np.mod(2 * (x + 3) / 6, 1), np.mod(3 * (3 - y) / 6, 1)  # texrepeat 2 3 over 6 metres
    row, column = (np.nan_to_num(a * 64).astype(int) % 64 for a in (t, s))
    expected = numbers[row, column] / 255
    away = (np.abs(s % 0.5 - 0.25) < 0.23) & (np.abs(t % 0.5 - 0.25) < 0.23)
    floor = np.isclose(frame["position"][..., 2], 0, atol=1e-5) & away
    assert floor.sum() > 1000 and len(np.unique(expected[floor][:, 0])) == 2
    np.testing.assert_allclose(frame["base_color"][floor], expected[floor], atol=0.02)


def test_names_classes_and_what_is_left_out(scene, stage):
    names = {body: entity.name for body, entity in stage.instances.items()}
    assert names == {"trunk": "things/trunk", "ball": "things/ball"}
    assert stage.cameras["eye"].world_transform[2, 3] == pytest.approx(0.9)
    warnings = " | ".join(stage.warnings)
    assert "1 geoms of groups 3 are left out" in warnings and "1 sites are left out" in warnings
    assert "camera 'chase' has mode track" in warnings and len(stage.warnings) == 3
    with scene.edit() as edit:
        more = edit.import_mjcf(
            mujoco.MjSpec.from_string(WORLD)
            if hasattr(mujoco, "MjSpec")
            else stage.shared.source.model,
            name="more",
            groups=range(6),
            sites=True,
            lights=False,
            category="thing",
            transform=ROOT,
        )
        copy = edit.import_mjcf(more, name="copy", lights=False)
        assert "mesh" not in {
            e.WhichOneof("action")
            for e in edit.transaction.edits
            if e.target.name.startswith("copy/") and not e.target.name.endswith("keypoint/mesh")
        }
    assert "hull" in more.geoms and "sole" in more.sites and not more.lights
    assert copy.geoms["toe"].mesh == more.geoms["toe"].mesh
    np.testing.assert_allclose(
        more.links["trunk"].world_transform[:3, 3], (ROOT @ (0, 0, 0.8, 1))[:3]
    )
    frame = scene.render(more.cameras["high"], planes=["semantic"], labels=True)
    rows = dict(zip(frame.labels["name"], frame.labels["category"].tolist(), strict=True))
    assert frame.categories[rows["more/ball"]] == frame.categories[rows["more/trunk"]] == "thing"
    assert rows["things/ball"] == 0
    again = pickle.loads(pickle.dumps(more))
    assert again.links == more.links and again.joint_names == more.joint_names


def test_joints_are_keypoints(scene, stage):
    model, data = simulated(1)
    with scene.edit() as edit:
        edit.set_joints(stage, data.qpos)
    frame = scene.render(stage.cameras["high"], planes=["depth"], labels={"keypoints": True})
    assert sorted(frame.labels["keypoint_name"]) == ["ankle", "roll", "root", "slot"]
    assert set(stage.skeleton) == {("root", "roll"), ("roll", "ankle"), ("root", "slot")}
    camera = frame.camera_from_world_cv
    for name, at in zip(
        frame.labels["keypoint_name"], frame.labels["keypoint_position_camera"], strict=True
    ):
        expected = camera[:3, :3] @ data.joint(name).xanchor + camera[:3, 3]
        if name != "slot":  # that of MuJoCo is before it slid
            np.testing.assert_allclose(at, expected, atol=1e-5)


def test_without_mujoco_the_extra_is_named(scene, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(hg.Unimplemented, match=r"heliograph\[mjcf\]"), scene.edit() as edit:
        edit.import_mjcf("things.xml")


def test_what_mujoco_refuses_is_told(scene, tmp_path):
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>")
    with (
        pytest.raises(hg.InvalidArgument, match=r"bad\.xml: MuJoCo refuses it"),
        scene.edit() as edit,
    ):
        edit.import_mjcf(tmp_path / "bad.xml")
    with pytest.raises(hg.NotFound, match=r"no file .*none\.xml"), scene.edit() as edit:
        edit.import_mjcf(tmp_path / "none.xml")
    with pytest.raises(hg.InvalidArgument, match="path: needs a file's path"), scene.edit() as edit:
        edit.import_mjcf(3)


def test_a_body_on_several_joints_is_one_instance(scene):
    """Planar walkers slide and turn on links of their own, above what is seen."""
    camera = '<camera name="cam" pos="0 -3 0.5" xyaxes="1 0 0 0 0 1" resolution="64 48"/>'
    cart = """<body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 0 1" pos="0 0 0.1"/><joint name="r" axis="0 1 0"/>
      <geom size="0.3"/><body name="pole"><joint name="p" axis="0 1 0" pos="0 0 0.3"/>
      <geom type="capsule" size="0.1 0.3" pos="0 0 0.5"/></body></body>"""
    text = f"<mujoco><worldbody>{camera}{cart}</worldbody></mujoco>"
    with scene.edit() as edit:
        robot = edit.import_mjcf(mujoco.MjModel.from_xml_string(text), name="w", category="cart")
    assert robot.instances["cart"].name == "w/cart:x"
    labels = {"keypoints": True, "keypoint_radius": 1.0}
    frame = scene.render(robot.cameras["cam"], planes=["instance", "part"], labels=labels)
    assert frame.labels["name"] == ["w/cart:x"]
    assert len(np.unique(frame["instance"])) == 2 and len(np.unique(frame["part"])) == 3
    assert set(frame.labels["keypoint_name"]) == {"x", "p"} and robot.skeleton == [("x", "p")]
    assert json.loads(robot.instances["cart"].attributes["skeleton"]) == [["x", "p"]]
