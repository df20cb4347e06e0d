"""Frames say why they are black or empty, and which light shines nowhere."""

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


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda edit: None, "the scene has no light; add a dome"),
        (box_around_the_camera, "the camera is inside 'box'"),
        (turn_away, "all of the scene is behind the camera"),
        (look_beside, "if it sees anything"),
        (hide_the_ball, "nothing in the scene has a mesh and is visible"),
    ],
)
def test_a_black_picture_says_why(scene, change, message):
    (warning,) = warnings_of(scene, change)
    assert message in warning


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


def test_labels_alone_say_nothing(scene):
    assert not warnings_of(scene, lambda edit: None, planes=("depth", "instance"))


@pytest.mark.parametrize("exposure, saturated", [(0, False), (8, True)])
def test_a_saturated_sensor_says_so(scene, exposure, saturated):
    def dazzle(edit):
        edit.dome(color=0.2)
        sensor = hg.RgbSensor(exposure=exposure)
        camera = hg.Camera.from_fov(45, 32, 24, degrees=True, rgb_sensor=sensor)
        edit.entity("cam", camera=camera)

    warnings = warnings_of(scene, dazzle, ["sensor_rgb"])
    assert [("of sensor_rgb is saturated" in each) for each in warnings] == [True] * saturated
