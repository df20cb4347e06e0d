"""Parts of exporters against closed forms: poses taken apart, what lamps give off, sRGB, PNG."""

import io
import math

import heliograph as hg
import numpy as np
import pytest
from heliograph.export.geometry import _merged, _unit
from heliograph.export.gltf.lights import SHAPES
from heliograph.export.gltf.write import unsheared
from heliograph.export.lamps import Lamp, irradiance, planckian_color, radiance, shape_extent
from heliograph.export.looks import from_srgb, to_srgb
from heliograph.export.motion import polar
from heliograph.image import png
from heliograph.values.pose import rotation_of_wxyz
from heliograph.values.rotations import quaternions_of
from PIL import Image


def matrices(count=200):
    """Affine maps, every second one a mirror."""
    rng = np.random.default_rng(0)
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3] = rng.normal(size=(count, 3, 4))
    wrong = (np.linalg.det(found[:, :3, :3]) > 0) == (np.arange(count) % 2 == 0)
    found[wrong, :3, 0] *= -1
    return found


def test_rotations_and_stretches_multiply_to_what_they_are_of():
    linear = matrices()[:, :3, :3]
    rotations, stretches = polar(linear)
    np.testing.assert_allclose(rotations @ stretches, linear, atol=1e-12)
    np.testing.assert_allclose(stretches, np.swapaxes(stretches, 1, 2), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1)
    for rotation in rotations:
        again = rotation_of_wxyz(quaternions_of(rotation))
        np.testing.assert_allclose(again, rotation, atol=1e-12)


def test_a_sheared_pose_is_two_without_shear():
    for matrix in matrices(40):
        outer, inner = unsheared(matrix)
        np.testing.assert_allclose(outer @ inner, matrix, atol=1e-12)
        axes = outer[:3, :3]
        off = axes.T @ axes
        np.testing.assert_allclose(off - np.diag(np.diag(off)), 0, atol=1e-12)
        np.testing.assert_allclose(inner[:3, :3] @ inner[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(inner) == pytest.approx(1)


def lamp(**given):
    return Lamp(hg.Light(**given).to_message())


def test_lamps_give_off_what_their_units_say():
    """A cone's flux by a sum over directions; the rest by the areas."""
    world = np.eye(4)
    ball = {"shape": "sphere", "radius": 0.5}
    for given, expected in (
        ({"radiance": 3}, 3),
        ({"luminance": 683}, 1),
        ({"power": 10}, 10 / (math.pi * math.pi)),
        ({"lumen": 683}, 1 / (math.pi * math.pi)),
        ({"candela": 683 * 2}, 2 / (math.pi * 0.25)),
        ({"intensity": 2, "exposure": 1}, 4 / (math.pi * 0.25)),
    ):
        one = lamp(**given, **ball)
        np.testing.assert_allclose(radiance(one, shape_extent(one, world)), expected, rtol=2e-4)
    cone = lamp(power=1, shape="disc", radius=1, outer_cone_angle=0.9, inner_cone_angle=0.4)
    angle = (np.arange(20000) + 0.5) / 20000 * (math.pi / 2)
    share = np.clip((np.cos(angle) - math.cos(0.9)) / (math.cos(0.4) - math.cos(0.9)), 0, 1) ** 2
    flux = (2 * math.pi * share * np.cos(angle) * np.sin(angle)).sum() * angle[0] * 2 * math.pi
    np.testing.assert_allclose(radiance(cone, shape_extent(cone, world)), 1 / flux, rtol=1e-4)
    stretched = np.diag([2, 3, 1, 1.0])
    plate = lamp(power=6 * math.pi, shape="rectangle")
    np.testing.assert_allclose(radiance(plate, shape_extent(plate, stretched)), 1)
    wide = lamp(radiance=2, sun_angle=math.pi / 2)
    np.testing.assert_allclose(irradiance(wide), math.pi)  # 2 pi sin^2(45 degrees)


def test_the_planckian_locus_is_where_it_is_known_to_be():
    """Chromaticities of black bodies in Wyszecki & Stiles, table 1(3.11), to the fit's accuracy."""
    to_xyz = np.linalg.inv(
        [[3.2404542, -1.5371385, -0.4985314], [-0.969266, 1.8760108, 0.041556],
         [0.0556434, -0.2040259, 1.0572252]]
    )  # fmt: skip
    for kelvin, x, y in ((2856, 0.4476, 0.4074), (5000, 0.3451, 0.3516), (6500, 0.3135, 0.3237)):
        xyz = to_xyz @ planckian_color(kelvin)
        np.testing.assert_allclose(xyz[:2] / xyz.sum(), (x, y), atol=4e-3)
        assert planckian_color(kelvin) @ (0.2126, 0.7152, 0.0722) == pytest.approx(1)


@pytest.mark.parametrize(("shape", "area"), [("sphere", 4 * math.pi), ("disc", math.pi),
                                             ("rectangle", 1)])  # fmt: skip
def test_meshes_of_lamps_have_the_lamps_area_and_side(shape, area):
    positions, indices = SHAPES[shape]()
    a, b, c = (positions[indices[:, i]].astype("f8") for i in range(3))
    normals = np.cross(b - a, c - a)
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, rel=1e-5)
    ahead = (a + b + c) if shape == "sphere" else np.array([0, 0, -1])
    assert ((normals * ahead).sum(1) > 0).all()


def test_srgb_there_and_back():
    levels = np.linspace(0, 1, 256, dtype="f4")
    np.testing.assert_allclose(to_srgb(from_srgb(levels)), levels, atol=1e-6)
    np.testing.assert_allclose(
        from_srgb(np.array([0.5, 0.02], "f4")), (0.2140, 0.001548), rtol=1e-3
    )


def test_joints_count_once_and_normals_have_a_direction():
    joints, weights = _merged(np.array([[3, 1, 3, 7]], "u2"), np.array([[0.2, 0.5, 0.3, 0]], "f4"))
    assert joints.tolist() == [[3, 1, 0, 0]]
    np.testing.assert_allclose(weights, [[0.5, 0.5, 0, 0]])
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], "f4")
    normals = np.array([[0, 3, 4], [0, 0, 0], [0, 0, 2], [0, 0, 0]], "f8")
    found = _unit(normals, points, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(found, [[0, 0.6, 0.8], [0, 0, 1], [0, 0, 1], [0, 0, 1]])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_pictures_are_those_that_another_program_reads(channels):
    texels = np.random.default_rng(channels).integers(0, 256, (5, 7, channels)).astype("u1")
    given = texels[..., 0] if channels == 1 else texels
    read = Image.open(io.BytesIO(png.encode(given)))
    assert read.mode == ("L", "LA", "RGB", "RGBA")[channels - 1]
    np.testing.assert_array_equal(np.asarray(read).reshape(texels.shape), texels)
