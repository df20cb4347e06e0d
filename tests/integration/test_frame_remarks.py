"""Frames say why they are black or show nothing, and which light shines nowhere."""

import heliograph as hg
import numpy as np
import pytest

AT_THE_ORIGIN = hg.look_at((0, -4, 0), (0, 0, 0))


def warnings_of(scene, change, planes=("beauty",)):
    with scene.edit() as edit:
        edit.entity("ball", mesh=edit.mesh("ball", **hg.shapes.sphere(1.0)))
        lens = hg.Camera.from_fov(45, 32, 24, degrees=True)
        edit.entity("cam", camera=lens, transform=AT_THE_ORIGIN)
        change(edit)
    return scene.render("cam", planes=list(planes), spp=4).warnings


def box_around_the_camera(edit):
    edit.dome(color=1.0)
    corners = np.stack(np.meshgrid([-9, 9], [-9, 9], [-9, 9], indexing="ij"), -1).reshape(-1, 3)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[i], q[i + 1]] for q in sides for i in (1, 2)]
    edit.entity("box", mesh=edit.mesh("box", positions=corners.astype("f4"), indices=faces))


def turn_away(edit):
    edit.dome(color=1.0, camera_visible=False)
    edit.entity("cam", transform=hg.look_at((0, -4, 0), (0, -8, 0)))


def look_beside(edit):
    edit.dome(color=1.0, camera_visible=False)
    edit.entity("cam", transform=hg.look_at((0, -4, 0), (8, 0, 0)))


def hide_the_ball(edit):
    edit.dome(color=1.0, camera_visible=False)
    edit.entity("ball", visible=False)


def glow(edit):
    edit.entity("ball", material=edit.material("glow", emission=1.0))


def lamp(**light):
    return lambda edit: edit.entity("key", light=hg.Light(**light), transform=hg.Pose((1, -3, 2)))


def hide_the_lamp(edit):
    lamp(power=9.0, shape="sphere", radius=0.1)(edit)
    edit.entity("key", visible=False)


def clip(**planes):
    def clipped(edit):
        edit.dome(color=1.0, camera_visible=False)
        edit.entity("cam", camera=hg.Camera.from_fov(45, 32, 24, degrees=True, **planes))

    return clipped


def shrink(edit):
    edit.dome(color=1.0, camera_visible=False)
    edit.entity("ball", transform=np.diag([1e-6, 1e-6, 1e-6, 1]))


def swell(edit):
    edit.dome(color=1.0)
    edit.entity("ball", transform=np.diag([1e6, 1e6, 1e6, 1]))


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda edit: None, "the scene has no light; add a dome"),
        (box_around_the_camera, "the camera is inside 'box'"),
        (turn_away, "all of the scene is behind the camera"),
        (look_beside, "if it sees anything"),
        (hide_the_ball, "nothing in the scene has a mesh and is visible"),
        (lamp(power=0, shape="sphere"), "light 'key' has a strength or a colour of 0"),
        (lamp(power=9, color=0, shape="sphere"), "light 'key' has a strength or a colour of 0"),
        (hide_the_lamp, "light 'key' is not visible"),
        (
            lambda edit: edit.dome(color=1.0, intensity=0.0),
            "the dome has no colour, or an intensity",
        ),
        (lambda edit: edit.material("m", emission=1.0), "the scene has no light; add a dome"),
        (clip(far=1.0), "all of the scene is farther than the camera's far of 1 m"),
        (clip(near=50.0), "all of the scene is nearer than the camera's near of 50 m"),
        (shrink, "all of the scene is smaller than a pixel"),
        (swell, "the camera is inside 'ball'"),
    ],
)
def test_a_black_picture_says_why(scene, change, message):
    (warning,) = warnings_of(scene, change)
    assert message in warning


def test_a_picture_of_the_sky_alone_says_what_is_not_in_it(scene):
    def beyond(edit):
        edit.dome(color=1.0)
        edit.entity("cam", transform=hg.look_at((0, -4, 0), (0, -8, 0)))

    (warning,) = warnings_of(scene, beyond)
    assert warning.startswith("nothing of the scene is in sight: all of the scene is behind")
    (warning,) = warnings_of(scene, beyond, planes=["depth"])
    assert warning.startswith("nothing of the scene is in sight: all of the scene is behind")


def test_a_light_without_a_shape_is_named(scene):
    def lamp(edit):
        edit.dome(color=1.0)
        edit.entity("key", light=hg.Light(power=100.0))
        edit.entity("rim", light=hg.Light(power=100.0))

    (warning,) = warnings_of(scene, lamp)
    assert "light 'key' (and 1 more) has neither a mesh nor a shape" in warning
    assert 'shape="sphere"' in warning


@pytest.mark.parametrize(
    "change",
    [
        lambda edit: edit.dome(color=0.1),
        lambda edit: edit.entity("sun", light=hg.Light(irradiance=1.0, sun_angle=0.01)),
        lambda edit: edit.entity("key", light=hg.Light(power=9.0, shape="sphere", radius=0.1)),
        glow,
    ],
)
def test_a_lit_picture_says_nothing(scene, change):
    def lit(edit):
        edit.entity("key", transform=hg.Pose((1, -3, 2)))
        change(edit)

    assert not warnings_of(scene, lit)


def test_a_light_group_without_light_is_named(scene):
    def groups(edit):
        edit.dome(color=1.0, light_group="sky")
        edit.entity("prop", light_group="rim")  # has no light of its own
        lamp(power=9.0, shape="sphere", radius=0.1)(edit)
        edit.entity("key", light_group="key", visible=False)

    planes = ("beauty", "beauty:sky", "beauty:rim", "beauty:key")
    [warning] = warnings_of(scene, groups, planes)
    assert "light group 'rim', 'key' is black" in warning and "set light_group" in warning
    with scene.edit() as edit:
        edit.entity("key", visible=True)
    [warning] = scene.render("cam", planes=["beauty:key", "beauty:rim"], spp=4).warnings
    assert "light group 'rim' is black" in warning


def test_labels_alone_say_nothing(scene):
    assert not warnings_of(scene, lambda edit: None, planes=("depth", "instance"))


@pytest.mark.parametrize("model", [{}, {"full_well": 8000, "read_noise": 3, "black_level": 0.05}])
@pytest.mark.parametrize("exposure, black", [(-20, True), (-2, False)])
def test_a_black_sensor_says_so(scene, exposure, black, model):
    def dim(edit):
        edit.dome(color=0.2)
        sensor = hg.RgbSensor(exposure=exposure, bits=12, **model)
        camera = hg.Camera.from_fov(45, 32, 24, degrees=True, rgb_sensor=sensor)
        edit.entity("cam", camera=camera)

    warnings = warnings_of(scene, dim, ["sensor_rgb"])
    assert [("sensor_rgb is black" in each) for each in warnings] == [True] * black


@pytest.mark.parametrize("exposure, saturated", [(0, False), (8, True)])
def test_a_saturated_sensor_says_so(scene, exposure, saturated):
    def dazzle(edit):
        edit.dome(color=0.2)
        sensor = hg.RgbSensor(exposure=exposure)
        camera = hg.Camera.from_fov(45, 32, 24, degrees=True, rgb_sensor=sensor)
        edit.entity("cam", camera=camera)

    warnings = warnings_of(scene, dazzle, ["sensor_rgb"])
    assert [("of sensor_rgb is saturated" in each) for each in warnings] == [True] * saturated
