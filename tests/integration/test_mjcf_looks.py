"""Looks of MJCF files in a real daemon: light, materials, cameras, tendons, skins."""

import heliograph as hg
import numpy as np
import pytest
from PIL import Image

mujoco = pytest.importorskip("mujoco")

CAMERA = '<camera name="cam" pos="0 -2 1" xyaxes="1 0 0 0 0.5 0.8" fovy="40" resolution="64 48"/>'


def imported(scene, world, rest="", **options):
    """The robot of a world's elements, and MuJoCo's model."""
    text = f"<mujoco>{rest}<worldbody>{world}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    with scene.edit() as edit:
        return edit.import_mjcf(model, name="it", **options), model


def linear(srgb):
    """IEC 61966-2-1, above its linear part."""
    return ((np.asarray(srgb) + 0.055) / 1.055) ** 2.4


MATTE = """<visual><headlight active="0"/></visual><statistic center="0 0 0" extent="1"/>
  <asset><material name="matte" specular="0" rgba="0.8 0.6 0.4 1"/></asset>"""
FLOOR = f'{CAMERA}<geom type="plane" size="5 5 1" material="matte"/>'


@pytest.mark.parametrize(
    ("light", "shown"),
    [
        ('<light type="directional" dir="0 0 -1" diffuse="0.5 0.7 0.9"/>', (0.5, 0.7, 0.9)),
        ('<light pos="0 0 2" dir="0 0 -1" diffuse="0.9 0.7 0.5"/>', (0.9, 0.7, 0.5)),
        ('<light type="point" pos="0 0 2" diffuse="0.9 0.7 0.5"/>', (0.9, 0.7, 0.5)),
        ('<light pos="0 0 2" dir="0 0 -1" attenuation="0 2 0"/>', None),
        ('<light diffuse="0 0 0" ambient="0.5 0.6 0.7" pos="0 0 2"/>', (0.5, 0.6, 0.7)),
        ('<light active="false"/>', (0, 0, 0)),
    ],
)
def test_what_one_light_shows_has_the_colour_of_mujoco(scene, light, shown):
    """Below the light, in the middle of the model."""
    robot, _ = imported(scene, light + FLOOR, MATTE)
    frame = scene.render(robot.cameras["cam"], planes=["beauty", "position"], spp=256)
    middle = np.linalg.norm(frame["position"], axis=-1) < 0.08
    assert middle.sum() > 4
    lit = linear(shown) if shown and any(shown) else np.zeros(3)
    if shown is None:
        lit = linear((0.7, 0.7, 0.7)) / 4  # at 2 m
    expected = linear((0.8, 0.6, 0.4)) * lit
    np.testing.assert_allclose(frame["beauty"][middle, :3].mean(0), expected, rtol=0.04, atol=1e-6)


def test_headlight_and_sky(scene):
    sky = '<texture type="skybox" builtin="flat" rgb1="0.2 0.4 0.6" width="16" height="16"/>'
    rest = MATTE.replace('active="0"', 'ambient="0.3 0.3 0.3" diffuse="0.4 0.4 0.4"')
    rest = rest.replace("<asset>", f"<asset>{sky}")
    robot, _ = imported(scene, FLOOR.replace("5 5 1", "0.5 0.5 1"), rest)
    frame = scene.render(robot.cameras["cam"], planes=["beauty", "coverage"], spp=256)
    floor, sky = frame["coverage"] == 1, frame["coverage"] == 0
    light = linear(0.7) + linear((0.2, 0.4, 0.6))
    expected = linear((0.8, 0.6, 0.4)) * light
    np.testing.assert_allclose(frame["beauty"][floor, :3].mean(0), expected, rtol=0.02)
    seen = np.median(frame["beauty"][sky, :3], axis=0)
    np.testing.assert_allclose(seen, linear((0.2, 0.4, 0.6)), rtol=0.01)


def test_a_spot_ends_at_its_cutoff(scene):
    light = '<light pos="0 0 2" dir="0 0 -1" cutoff="20" exponent="0"/>'
    robot, _ = imported(scene, light + FLOOR, MATTE)
    frame = scene.render(robot.cameras["cam"], planes=["beauty", "position"], spp=64)
    x, y, _ = np.moveaxis(frame["position"], -1, 0)
    angle = np.degrees(np.arctan2(np.hypot(x, y), 2))
    lit = frame["beauty"][..., 1] > 1e-3
    assert lit[angle < 17].all() and not lit[angle > 25].any()


def test_parameters_of_materials(scene):
    assets = """<asset>
      <material name="shiny" shininess="1" specular="0.3" rgba="0.2 0.4 0.6 0.5"/>
      <material name="mirror" reflectance="0.4"/>
      <material name="lamp" emission="0.5" rgba="1 0.5 0.25 1"/>
      <material name="metal" metallic="0.8" roughness="0.3"/>
    </asset>"""
    names = ("shiny", "mirror", "lamp", "metal")
    world = "".join(f'<geom name="{n}" type="box" size="1 1 1" material="{n}"/>' for n in names)
    world += '<geom name="own" type="sphere" size="1" material="shiny" rgba="1 0 0 1"/>'
    world += '<geom name="gone" type="sphere" size="1" rgba="0 0 0 0"/>'
    robot, _ = imported(scene, world, assets)
    assert "gone" not in robot.geoms
    found = {name: robot.geoms[name].materials[0].parameters for name in (*names, "own")}
    assert found["shiny"]["base_color"] == pytest.approx(linear((0.2, 0.4, 0.6)), rel=1e-4)
    assert found["shiny"]["alpha"] == pytest.approx(0.5)
    assert found["shiny"]["specular"] == pytest.approx(0.3)
    assert found["shiny"]["roughness"] == pytest.approx((2 / 130) ** 0.25)
    assert found["own"]["base_color"] == pytest.approx((1, 0, 0))
    assert found["mirror"]["metallic"] == pytest.approx(0.4)
    assert found["mirror"]["roughness"] == 0
    assert found["lamp"]["emission"] == pytest.approx(linear((0.5, 0.25, 0.125)), rel=1e-4)
    assert found["metal"]["metallic"] == pytest.approx(0.8)
    assert found["metal"]["roughness"] == pytest.approx(0.3)


# By face: where it is, and what is up and left in its picture (OpenGL 4.6, table 8.19).
FACES = {
    "right": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "left": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "up": ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
    "down": ((0, -1, 0), (0, 0, 1), (-1, 0, 0)),
    "front": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "back": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
}


def face_picture(number):
    """Red in its left half, green in its upper one, as blue as its number."""
    out = np.zeros((16, 16, 3), "u1")
    out[:, :8, 0], out[:8, :, 1], out[..., 2] = 200, 200, 50 + 40 * number
    return out


@pytest.mark.parametrize("shape", ['box" size="1 1 1', 'sphere" size="1', 'ellipsoid" size="1 2 3'])
def test_six_faces_lie_about_a_geom(scene, tmp_path, shape):
    for number, name in enumerate(FACES):
        Image.fromarray(face_picture(number)).save(tmp_path / f"{name}.png")
    files = " ".join(f'file{name}="{tmp_path}/{name}.png"' for name in FACES)
    assets = f"""<asset><texture name="t" type="cube" {files}/><material name="m" texture="t"/>
      </asset>"""
    robot, model = imported(scene, f'<geom name="g" type="{shape}" material="m"/>', assets)
    lens = hg.Camera.from_fov(50, 48, 48, degrees=True)
    size = np.where(model.geom_size[0] > 0, model.geom_size[0], model.geom_size[0, 0])
    for number, (towards, up, left) in enumerate(np.array(list(FACES.values()), float)):
        with scene.edit() as edit:
            edit.entity("eye", camera=lens, transform=hg.look_at(8 * towards, (0, 0, 0)))
        frame = scene.render("eye", planes=["base_color", "position"], spp=1)
        at = frame["position"] / size
        ahead, high, far_left = (at @ axis for axis in (towards, up, left))
        of_face = (ahead > 1.05 * np.abs(high)) & (ahead > 1.05 * np.abs(far_left))
        clear = of_face & (np.abs(high) > 0.15 * ahead) & (np.abs(far_left) > 0.15 * ahead)
        expected = np.stack([far_left > 0, high > 0, ahead > 0], axis=-1)[clear] * 1.0
        expected *= linear(np.array((200, 200, 50 + 40 * number)) / 255)
        assert clear.sum() > 20 and len(np.unique(expected, axis=0)) == 4
        np.testing.assert_allclose(frame["base_color"][clear], expected, atol=0.01)


def test_cameras_have_the_intrinsics_of_the_file(scene):
    world = """<camera name="wide" fovy="60"/>
      <camera name="chip" resolution="200 100" sensorsize="0.02 0.01" focal="0.01 0.012"
        principal="0.001 0.0005"/>
      <camera name="flat" fovy="3" resolution="30 40" {}/>"""
    is_new = hasattr(mujoco.MjModel, "cam_projection")
    flat = 'projection="orthographic"' if is_new else 'orthographic="true"'
    rest = '<statistic extent="3"/><visual><map znear="0.02"/></visual>'
    robot, model = imported(scene, world.format(flat), rest, size=(320, 240))
    wide, chip, flat = (robot.cameras[name].camera for name in ("wide", "chip", "flat"))
    assert (wide.width, wide.height) == (320, 240)
    assert wide.fy == pytest.approx(120 / np.tan(np.radians(30))) and wide.fx == wide.fy
    assert wide.near == pytest.approx(0.06)
    assert (chip.fx, chip.fy) == pytest.approx((100, 120))
    assert (chip.cx, chip.cy) == pytest.approx((99.5 - 10, 49.5 - 5))  # MuJoCo 4's frustum, below
    if int(mujoco.__version__.split(".")[0]) < 4:
        return  # it had the principal point upside down
    data, view = mujoco.MjData(model), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera("chip").id
    drawn = mujoco.MjvScene(model, 10)
    every = int(mujoco.mjtCatBit.mjCAT_ALL)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, every, drawn)
    seen = drawn.camera[0]
    top, bottom, half = seen.frustum_top, seen.frustum_bottom, seen.frustum_width
    assert chip.cy + 0.5 == pytest.approx(100 * top / (top - bottom))
    assert chip.cx + 0.5 == pytest.approx(200 * (half - seen.frustum_center) / (2 * half))
    assert chip.fx == pytest.approx(100 * seen.frustum_near / half)
    assert chip.near == pytest.approx(seen.frustum_near)
    assert flat.projection == "orthographic" and flat.fx == pytest.approx(40 / 3)


# ------------------------------------------------------------ tendons and skins


def surface(scene, camera, model, data, robot):
    """A frame at data's qpos, after mj_forward."""
    mujoco.mj_forward(model, data)
    with scene.edit() as edit:
        edit.set_joints(robot, data.qpos)
    return scene.render(camera, planes=["position", "primitive", "barycentric", "part"], spp=1)


def test_tendons_go_from_site_to_site_wherever_these_are(scene):
    camera = CAMERA.replace("64 48", "128 96")
    world = f"""{camera}<site name="fixed" pos="-0.3 0 0"/>
      <body><joint name="x" type="slide" axis="1 0 0"/><joint name="turn" axis="0 0 1"/>
        <geom size="0.01" group="4"/><site name="moved" pos="0.2 0 0.2"/></body>"""
    rest = """<tendon><spatial name="rope" width="0.02" rgba="1 0 0 1"><site site="fixed"/>
      <site site="moved"/></spatial></tendon>"""
    text = f"<mujoco><worldbody>{world}</worldbody>{rest}</mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    with scene.edit() as edit:
        robot = edit.import_mjcf(model, name="it")
    assert list(robot.tendons) == ["rope"] and not any("rope" in w for w in robot.warnings)
    data = mujoco.MjData(model)
    for qpos in ((0, 0), (0.2, 0.5), (-0.1, -0.4)):
        data.qpos[:] = qpos
        frame = surface(scene, robot.cameras["cam"], model, data, robot)
        points = frame["position"][np.isfinite(frame["position"][..., 0])]
        a, b = data.site("fixed").xpos, data.site("moved").xpos
        along = (points - a) @ (b - a) / ((b - a) @ (b - a))
        away = np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
        assert len(points) > 50 and away.max() < 0.0201 and along.min() < 0.1 and along.max() > 0.9
        assert np.median(away) > 0.01


def test_skins_follow_their_bones_as_in_mujoco(scene):
    camera = CAMERA.replace("64 48", "128 96")
    world = f"""{camera}<body name="a" pos="-0.2 0 0"><joint axis="0 1 0"/>
      <geom size="0.01" group="4"/>
      <body name="b" pos="0.4 0 0"><joint name="j" axis="0 1 0"/>
      <geom size="0.01" group="4"/></body>
      </body>"""
    vertices = np.array([[-0.4, 0, -0.2], [0, 0, -0.2], [0, 0, 0.2], [0.4, 0, -0.1]])
    bones = {
        "a": ((-0.2, 0, 0), (0, 1, 2), (1, 0.5, 0.3)),
        "b": ((0.2, 0, 0), (1, 2, 3), (0.5, 0.7, 1)),
    }
    text = "".join(
        f"""<bone body="{body}" bindpos="{" ".join(map(str, at))}" bindquat="1 0 0 0"
        vertid="{" ".join(map(str, which))}" vertweight="{" ".join(map(str, weights))}"/>"""
        for body, (at, which, weights) in bones.items()
    )
    skin = f"""<deformable><skin name="coat" vertex="{" ".join(map(str, vertices.ravel()))}"
      face="0 1 2 1 3 2">{text}</skin></deformable>"""
    xml = f"<mujoco><worldbody>{world}</worldbody>{skin}</mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    with scene.edit() as edit:
        robot = edit.import_mjcf(model, name="it")
    assert list(robot.skins) == ["coat"]
    data = mujoco.MjData(model)
    for qpos in ((0, 0), (0.4, -0.7)):
        data.qpos[:] = qpos
        frame = surface(scene, robot.cameras["cam"], model, data, robot)
        expected = np.zeros((4, 3))
        for body, (at, which, weights) in bones.items():
            place = data.body(body)
            moved = (vertices - at) @ place.xmat.reshape(3, 3).T + place.xpos
            expected[list(which)] += np.array(weights)[:, None] * moved[list(which)]
        corners = expected[[[0, 1, 2], [1, 3, 2]]]
        seen = np.isfinite(frame["position"][..., 0])
        b = frame["barycentric"][seen]
        weights = np.column_stack([1 - b.sum(1), b])
        points = np.einsum("pk,pkj->pj", weights, corners[frame["primitive"][seen]])
        assert set(frame["primitive"][seen]) == {0, 1} and seen.sum() > 300
        np.testing.assert_allclose(frame["position"][seen], points, atol=1e-4)


def test_what_cannot_be_followed_is_told(scene):
    world = """<geom name="pin" type="cylinder" size="0.1 0.2"/><site name="a" pos="-0.5 0.05 0"/>
      <site name="side" pos="0 0.2 0"/>
      <body><joint name="x" axis="0 0 1"/><joint name="y" axis="0 1 0"/>
        <geom size="0.01" pos="0.5 0 0"/><site name="b" pos="0.5 0.05 0"/></body>
      <light name="star" mode="targetbody" target="ball" pos="1 1 1"/>
      <body name="ball" pos="0 1 0"><geom size="0.1"/></body>"""
    rest = """<tendon><spatial name="rope" width="0.01"><site site="a"/>
      <geom geom="pin" sidesite="side"/><site site="b"/></spatial>
      <fixed name="link"><joint joint="x" coef="1"/></fixed></tendon>
      <equality><joint joint1="x" joint2="y"/></equality>
      <deformable><flex name="cloth" dim="2" body="ball ball ball" vertex="0 0 0 1 0 0 0 1 0"
        element="0 1 2"/></deformable>"""
    text = f"<mujoco><worldbody>{world}</worldbody>{rest}</mujoco>"
    with scene.edit() as edit:
        robot = edit.import_mjcf(mujoco.MjModel.from_xml_string(text), name="it")
    warnings = " | ".join(robot.warnings)
    for what in (
        "flex 'cloth' is left out",
        "1 equality constraints are not kept",
        "3 sites are left out",
        "tendon 'rope' winds around a geom",
        "light 'star' has mode targetbody",
    ):
        assert what in warnings, warnings
    assert list(robot.tendons) == ["rope"] and len(robot.warnings) == 5
