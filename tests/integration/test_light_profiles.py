"""Luminaires with an .ies file through the daemon: illuminance = I(direction) cos / d^2."""

from dataclasses import replace
from pathlib import Path

import heliograph as hg
import numpy as np
import pytest

FILE = Path(__file__).resolve().parents[1] / "assets/profile/batwing.ies"
VERTICAL, HORIZONTAL = np.arange(0, 91, 15.0), np.array([0, 45, 90.0])
CANDELA = 1.8 * np.array(
    [
        [100, 110, 130, 120, 60, 20, 0],
        [100, 120, 160, 170, 90, 25, 0],
        [100, 130, 190, 220, 120, 30, 0],
    ]
)
SHAPES = (
    {"shape": "sphere", "radius": 0.01},
    {"shape": "disc", "radius": 0.01},
    {"shape": "rectangle", "width": 0.03, "height": 0.02},
)
LAMP = hg.Pose((0.3, -0.2, 2), euler=(0.3, -0.2, 0.7)).matrix
POINTS = np.array([[0.5, -0.2], [1.5, 1], [-1, 2], [-2, -1.5], [0.3, 2.5], [2, -2]])


def candela(direction):
    """Candela of the file in a direction of the light's frame: between the angles linearly."""
    x, y, z = direction
    vertical = np.degrees(np.arctan2(np.hypot(x, y), -z))
    horizontal = np.degrees(np.arctan2(abs(y), abs(x)))  # both planes are planes of symmetry
    rows = [np.interp(vertical, VERTICAL, row, right=0) for row in CANDELA]
    return np.interp(horizontal, HORIZONTAL, rows)


def illuminance(point):
    d = np.array([*point, 0]) - LAMP[:3, 3]
    return candela(LAMP[:3, :3].T @ d / np.linalg.norm(d)) * -d[2] / np.linalg.norm(d) ** 3


def lumens():
    """By quadrature over the sphere."""
    n = 400
    vertical, around = (np.arange(n) + 0.5) / n * np.pi, (np.arange(n) + 0.5) / n * 2 * np.pi
    v, h = np.meshgrid(vertical, around)
    directions = np.stack([np.sin(v) * np.cos(h), np.sin(v) * np.sin(h), -np.cos(v)])
    values = [candela(d) * np.hypot(d[0], d[1]) for d in directions.reshape(3, -1).T]
    return np.sum(values) * 2 * np.pi**2 / n**2


@pytest.fixture(scope="module")
def hall(client):
    """A matt floor, and a small camera that looks at each of the POINTS."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            ground = edit.mesh(**hg.shapes.plane(20))
            edit.material("white", base_color=0.5, specular=0)
            edit.entity("floor", mesh=ground, material="white")
            edit.texture("batwing", FILE)
            for i, (x, y) in enumerate(POINTS):
                camera = hg.Camera.orthographic(1000, 4, 4)
                edit.entity(f"cam{i}", camera=camera, transform=hg.Pose((x, y, 0.5)))
        yield scene


def measured(scene, **light):
    with scene.overlay() as lit:
        lit.entity("lamp", light=hg.Light(profile="batwing", **light), transform=LAMP)
    frames = scene.render([f"cam{i}" for i in range(len(POINTS))], spp=256, overlay=lit)
    return np.array([frame["beauty"][..., 1].mean() for frame in frames]) * np.pi / 0.5 * 683


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape["shape"])
def test_the_file_gives_the_illuminance(hall, shape):
    want = [illuminance(point) for point in POINTS]
    assert min(want) > 1
    np.testing.assert_allclose(measured(hall, **shape), want, rtol=0.01)
    np.testing.assert_allclose(
        measured(hall, profile_scale=0.25, **shape), 0.25 * np.array(want), rtol=0.01
    )


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape["shape"])
def test_other_units_scale_the_file(hall, shape):
    want = np.array([illuminance(point) for point in POINTS])
    np.testing.assert_allclose(
        measured(hall, candela=1000, **shape), want * 1000 / CANDELA.max(), rtol=0.01
    )
    np.testing.assert_allclose(
        measured(hall, lumen=1000, **shape), want * 1000 / lumens(), rtol=0.01
    )


def test_an_array_is_a_profile_and_is_read_back(hall):
    with hall.branch() as scene:
        with scene.edit() as edit:
            up = edit.texture("up", np.array([[0.0], [0], [1]], "f4"))
            lamp = hg.Light(power=2, shape="sphere", profile=up)
            edit.entity("lamp", light=lamp, transform=hg.Pose((0, 0, 3)))
        assert scene["lamp"].light == replace(lamp, color=(1, 1, 1), radius=1)
        assert scene.render("cam0", spp=4)["beauty"][..., 1].max() == 0
        with scene.edit() as edit:
            edit.update("lamp", transform=hg.Pose((0, 0, 3), euler=(np.pi, 0, 0)))
        assert scene.render("cam0", spp=4)["beauty"][..., 1].min() > 0
        with pytest.raises(hg.FailedPrecondition, match="lamp"), scene.edit() as edit:
            edit.remove("up")


def test_the_texture_of_a_light_is_read_back(hall):
    with hall.branch() as scene:
        with scene.edit() as edit:
            dots = edit.texture("dots", np.eye(2, dtype="f4"))
            use = hg.Tex(dots, scale=2, offset=0.5, uv=((0, 1, 0.5), (1, 0, 0)), uv_set=1)
            sheet = edit.mesh(**hg.shapes.plane(1))
            for name, texture in (("sheet", use), ("plain", dots)):
                edit.entity(name, mesh=sheet, light=hg.Light(power=2, texture=texture))
        assert scene["sheet"].light.texture == use
        assert scene["plain"].light.texture == hg.Tex(dots)
        again = scene["sheet"].light
        with scene.edit() as edit:
            edit.update("sheet", light=again)
        assert scene["sheet"].light == again


def test_a_scene_file_keeps_it(hall, client, tmp_path):
    with hall.branch() as scene:
        with scene.edit() as edit:
            lamp = hg.Light(profile="batwing", **SHAPES[0])
            edit.entity("lamp", light=lamp, transform=LAMP)
        scene.save(tmp_path / "hall.helio")
        with client.load_scene(tmp_path / "hall.helio") as again:
            one, other = (s.render("cam1", spp=4)["beauty"] for s in (scene, again))
    assert one.max() > 0
    np.testing.assert_array_equal(one, other)
