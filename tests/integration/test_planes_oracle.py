"""Every centre plane against numpy arithmetic on the same scene (oracle.py)."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import trace
from oracle_world import HEIGHT, WIDTH, K, Truth, World, project


@pytest.fixture(scope="module")
def world(client: hg.Client) -> World:
    return World(client)


@pytest.fixture(scope="module", params=[0, 1], ids=["old", "new"])
def pair(request: pytest.FixtureRequest, world: World) -> tuple[hg.Frame, Truth]:
    return world.frames[request.param], Truth(world, request.param)


def flat(frame: hg.Frame, plane: str) -> np.ndarray:
    return np.asarray(frame[plane]).reshape(WIDTH * HEIGHT, -1)


def test_ids(pair):
    frame, truth = pair
    sure = truth.sure | ~truth.hit & ~np.isfinite(flat(frame, "depth")[:, 0])
    assert sure.mean() > 0.95
    expected = {
        "instance": truth.per_thing([t.label for t in truth.things]),
        "semantic": truth.per_thing([t.category for t in truth.things]),
        "primitive": np.where(truth.hit, truth.hits.triangle, 0xFFFFFFFF),
    }
    mesh_part = np.zeros(len(truth.hit), int)
    for index, thing in enumerate(truth.things):
        mine = truth.hits.thing == index
        mesh_part[mine] = thing.first_part + (
            thing.parts[truth.hits.triangle[mine]] if thing.parts is not None else 0
        )
    expected["part"] = mesh_part
    for name, value in expected.items():
        assert frame[name].dtype == np.uint32
        np.testing.assert_array_equal(flat(frame, name)[sure, 0], value[sure], err_msg=name)


def test_an_entity_that_is_given_a_part_is_that_part_whole(world):
    """The crate's two mesh parts are 1 and 2, those of its lid 3 and 4."""
    before = world.frames[1]["part"]
    numbers = [{"lid": 9}, {"lid": 1}, {"crate": 2}, {"crate": 4, "lid": 4}]
    expected = [(0, 1, 2, 9, 9), (0, 2, 3, 1, 1), (0, 2, 2, 3, 4), (0, 4, 4, 4, 4)]
    crate = world.frames[1]["instance"] == 5
    assert set(np.unique(before[crate])) == {1, 2, 3, 4}
    for given, renumbered in zip(numbers, expected, strict=True):
        with world.scene.overlay() as overlay:
            for name, part in given.items():
                label = {"label": 5} if name == "crate" else {}
                overlay.update(name, part=part, **label)
        frame = world.scene.render("cam", planes=["part", "material"], overlay=overlay)
        np.testing.assert_array_equal(frame["part"][crate], np.choose(before[crate], renumbered))
        np.testing.assert_array_equal(frame["part"][~crate], before[~crate])
        np.testing.assert_array_equal(frame["material"], world.frames[1]["material"])


def test_geometry(pair):
    frame, truth = pair
    sure = truth.sure
    length = np.linalg.norm(truth.directions, axis=1)
    camera = truth.position @ truth.camera[:3, :3].T + truth.camera[:3, 3]
    normal = truth.geometric_normals()
    # Four roundings of the distance, along the surface: the camera's pose is in single precision.
    distance = truth.hits.t * length
    cosine = np.abs((normal * truth.directions).sum(1)) / length
    room = (2**-22 * distance / np.maximum(cosine, 1e-9))[sure]
    for name, value in [
        ("depth", truth.hits.t[:, None]),
        ("distance", distance[:, None]),
        ("position", truth.position),
        ("position_camera", camera),
    ]:
        np.testing.assert_allclose(
            flat(frame, name)[sure], value[sure], rtol=2e-5, atol=2e-5, err_msg=name
        )
        error = np.linalg.norm(flat(frame, name)[sure] - value[sure], axis=1)
        assert (error <= room).all(), (name, (error / room).max())
    np.testing.assert_allclose(flat(frame, "geometric_normal")[sure], normal[sure], atol=1e-6)
    uv = truth.corner_values("uvs", 2)
    np.testing.assert_allclose(flat(frame, "uv")[sure], uv[sure], rtol=0, atol=2.5e-4)
    bary = np.stack([truth.hits.u, truth.hits.v], -1)
    np.testing.assert_allclose(flat(frame, "barycentric")[sure], bary[sure], rtol=0, atol=2e-4)


def test_shading_normals(pair):
    frame, truth = pair
    ball = truth.sure & (truth.hits.thing == 1)
    assert ball.sum() > 100
    thing = truth.things[1]
    smooth = truth.corner_values("normals", 3)[ball] @ np.linalg.inv(thing.world[:3, :3])
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    got = flat(frame, "normal")[ball]
    np.testing.assert_allclose(got, smooth, atol=1e-4)
    np.testing.assert_allclose(
        flat(frame, "normal_camera")[ball], got @ truth.camera[:3, :3].T, atol=1e-5
    )
    rest = truth.sure & (truth.hits.thing != 1)
    np.testing.assert_allclose(
        flat(frame, "normal")[rest], flat(frame, "geometric_normal")[rest], atol=1e-6
    )


def test_material_parameters(pair):
    frame, truth = pair
    steel = np.zeros(len(truth.hit), bool)
    for index, swap in ((1, None), (2, False), (3, True)):
        mine = truth.hits.thing == index
        part = 1 if swap is None else truth.things[index].parts[truth.hits.triangle[mine]]
        steel[mine] = np.asarray(part) != (1 if swap else 0)
    sure = truth.sure
    np.testing.assert_allclose(flat(frame, "metallic")[sure, 0], steel[sure])
    np.testing.assert_allclose(
        flat(frame, "roughness")[sure, 0], np.where(steel, 0.125, 0.25)[sure]
    )
    base = np.where(steel[:, None], (0.7, 0.7, 0.6), (0.5, 0.4, 0.3))
    np.testing.assert_allclose(flat(frame, "base_color")[sure], base[sure], rtol=1e-6)


def test_object_coordinates(pair):
    frame, truth = pair
    ball = truth.sure & (truth.hits.thing == 1)
    points = truth.things[1].positions
    rest = truth.corner_values("positions", 3)[ball] * np.array([0.9, 0.5, 0.7])
    low, high = points.min(0) * [0.9, 0.5, 0.7], points.max(0) * [0.9, 0.5, 0.7]
    np.testing.assert_allclose(
        flat(frame, "object_coordinates")[ball], (rest - low) / (high - low), atol=1e-4
    )
    nocs = 0.5 + (rest - (low + high) / 2) / np.linalg.norm(high - low)
    np.testing.assert_allclose(flat(frame, "nocs")[ball], nocs, atol=1e-4)


@pytest.mark.parametrize(("k", "name"), [(0, "flow_forward"), (1, "flow_backward")])
def test_flow_is_reprojection(world, k, name):
    frame, truth = world.frames[k], Truth(world, k)
    moved = np.zeros_like(truth.position)
    for index, thing in enumerate(truth.things):
        mine = truth.hits.thing == index
        there = world.states[1 - k][index].world @ np.linalg.inv(thing.world)
        moved[mine] = truth.position[mine] @ there[:3, :3].T + there[:3, 3]
    other = world.camera_from_world(1 - k)
    here = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    expected = project(other, moved) - here
    sure = truth.sure
    np.testing.assert_allclose(flat(frame, name)[sure], expected[sure], atol=0.01)
    assert flat(frame, name + "_valid").all()
    if name == "flow_forward":
        np.testing.assert_allclose(
            flat(frame, "scene_flow")[sure], (moved - truth.position)[sure], atol=1e-5
        )

    # The background moves as points at infinity do.
    away = ~truth.hit
    assert away.sum() > 50
    turned = truth.directions[away] @ other[:3, :3].T
    infinity = turned[:, :2] / turned[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
    np.testing.assert_allclose(flat(frame, name)[away], infinity - here[away], atol=0.01)

    # Visible there: the other camera's ray to the moved point meets nothing on its way.
    eye = -other[:3, :3].T @ other[:3, 3]
    blocked = trace(world.states[1 - k], eye, moved - eye)
    raster = project(other, moved) + 0.5
    inside = (raster >= 0).all(1) & (raster[:, 0] < WIDTH) & (raster[:, 1] < HEIGHT)
    seen = inside & (blocked.t > 1 - 1e-4)
    clear = sure & (blocked.margin > 2e-3) & (np.abs(blocked.t - 1) < 1e-4) | sure & (
        blocked.t < 0.99
    )
    assert (flat(frame, name + "_visible")[clear, 0] == seen[clear]).mean() > 0.998


def test_empty_pixels(pair):
    frame, truth = pair
    away = ~truth.hit & (flat(frame, "instance")[:, 0] == 0)
    assert away.sum() > 50
    assert np.isposinf(flat(frame, "depth")[away]).all()
    assert np.isposinf(flat(frame, "distance")[away]).all()
    for name in ("position", "position_camera", "object_coordinates", "nocs"):
        assert np.isnan(flat(frame, name)[away]).all(), name
    for name in ("normal", "geometric_normal", "uv", "base_color", "instance", "semantic", "part"):
        assert (flat(frame, name)[away] == 0).all(), name
    for name in ("material", "primitive"):
        assert (flat(frame, name)[away] == 0xFFFFFFFF).all(), name
