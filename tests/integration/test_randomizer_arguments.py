"""Randomizers with odd arguments: errors name the field, and of nothing there is nothing to do."""

import math

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from drawing import drawn, seen

RED, BLUE = (np.full((4, 4, 3), color, "u1") for color in ((255, 0, 0), (0, 0, 255)))
LINE = [(0, -2, 1), (2, 0, 1)]


@pytest.fixture(scope="module")
def stage(client):
    """A floor, two squares and a camera above."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            square = edit.mesh("square", **hg.shapes.plane(1.0))
            for name, x in (("left", -0.6), ("right", 0.6)):
                pose = hg.Pose((x, 0, 0.1))
                edit.entity(name, mesh=square, transform=pose, category="square")
            edit.texture("red", RED)
            lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -0.01, 2.5), (0, 0, 0)))
        yield scene


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("distance", lambda: hd.orbit("cam", "left", distance="far")),
        ("distance", lambda: hd.orbit("cam", "left", distance=(1, "far"))),
        ("distance", lambda: hd.orbit("cam", "left", distance=(1,))),
        ("offset", lambda: hd.look_at_jitter("cam", "left", offset=(0, 1))),
        ("radius", lambda: hd.scatter("left", on="floor", radius=(1, 2))),
        ("max_slope", lambda: hd.scatter("left", on="floor", max_slope=45)),
        ("radius", lambda: hd.shell("left", "right", radius=lambda rng: 1)),
        ("friction", lambda: hd.settle("left", on="floor", friction="wood")),
        ("count", lambda: hd.random_lights("2")),
        ("count", lambda: hd.random_lights((1.2, 1.8))),
        ("color", lambda: hd.random_lights(2, color=((1, 1, 1), (0, 0, 0)))),
        ("log_uniform", lambda: hd.log_uniform("a", 1)),
        ("log_uniform", lambda: hd.log_uniform(1, math.inf)),
        ("points", lambda: hd.camera_path("cam", [*LINE, LINE[0]], frames=3, loop=True)),
    ],
)
def test_an_argument_that_cannot_be_is_refused_by_name(field, make):
    with pytest.raises(hg.InvalidArgument, match=f"^{field}: ") as refused:
        make()
    assert refused.value.field == field


@pytest.mark.parametrize(
    ("field", "randomizer"),
    [
        ("target", hd.orbit("cam", [], distance=1)),
        ("around", hd.scatter("left", on="floor", around=(0, 0, math.nan))),
        ("on", hd.scatter("left", on=[])),
        ("box", hd.in_volume("left", [])),
        ("on", hd.settle(["left", "right"], on=["floor", "right"])),
        ("least", hd.in_view(lambda draw: None, ["left", "right"], least=3)),
        ("entity", hd.camera_path(["cam"], LINE, frames=3)),
    ],
)
def test_what_a_draw_cannot_do_is_refused_by_name(stage, field, randomizer):
    pytest.importorskip("pybullet")
    with pytest.raises(hg.InvalidArgument, match=rf"^{field}\b") as refused:
        drawn(stage, "cam", randomizer)
    assert refused.value.field.startswith(field)


@pytest.mark.parametrize(
    "randomizer",
    [
        hd.scatter([], on="floor"),
        hd.in_volume([], ((0, 0, 0), (1, 1, 1))),
        hd.shell([], (0, 0, 0), radius=1),
        hd.settle([], on="floor"),
        hd.random_lights(0),
    ],
)
def test_of_nothing_there_is_nothing_to_do(stage, randomizer):
    assert not drawn(stage, "cam", randomizer).edit.transaction.edits


def color_at(frame, x):
    return frame["beauty"][frame.height // 2, x, :3]


def test_randomizers_of_one_kind_do_not_undo_each_other(stage):
    dressed = hd.Compose(hd.random_textures("left", RED), hd.random_textures("right", BLUE))
    frame = stage.render("cam", overlay=drawn(stage, "cam", dressed).edit, spp=4)
    left, right = color_at(frame, 16), color_at(frame, 48)
    assert left[0] > 4 * left[2] and right[2] > 4 * right[0]
    lit = hd.Compose(hd.random_lights(2), hd.random_lights(3))
    with seen(stage, drawn(stage, "cam", lit)) as branch:
        assert len(branch.find("random/light/*")) == 5


def test_one_picture_needs_no_list(stage):
    dome = drawn(stage, "cam", hd.random_dome(np.ones((4, 8, 3), "f4"))).edit.transaction
    shapes = [each.texture.texels.shape for each in dome.edits if each.HasField("texture")]
    assert shapes == [[4, 8, 3]]
    texture = stage["red"]
    for images in (texture, (texture,)):
        draw = drawn(stage, "cam", hd.random_textures("left", images))
        assert not any(each.HasField("texture") for each in draw.edit.transaction.edits)
    with pytest.raises(hg.InvalidArgument, match="images: has textures of the scene and other"):
        hd.random_textures("left", [texture, RED])
