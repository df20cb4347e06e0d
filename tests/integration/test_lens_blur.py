"""Blur of a thin lens against its formula: a point at distance z is a disc fx * A * |1/z - 1/f|
pixels wide, an image of the aperture."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest

FOCUS, APERTURE = 2.0, 0.1
FOCAL, SIDE = 400.0, 48
RADIUS = 2 / FOCAL  # of the ball at 1 m; it grows with the distance, so that its image is 4 pixels


@pytest.fixture(scope="module")
def blurred(client):
    """blurred(z, **fields): the coverage of a small ball straight ahead, and its camera."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("ball/mesh", **hg.shapes.sphere(RADIUS))

        def render(z, size=None, side=SIDE, **fields):
            intrinsics = {"fx": FOCAL, "fy": FOCAL, "cx": side / 2 - 0.5, "cy": side / 2 - 0.5}
            lens = {"aperture": APERTURE, "focus_distance": FOCUS}
            camera = hg.Camera(**{"width": side, "height": side, **intrinsics, **lens, **fields})
            with scene.edit() as edit:
                edit.entity("ball", mesh="ball/mesh", transform=hg.Pose((0, 0, -z), scale=z))
                edit.entity("cam", camera=camera)
            options = {"size": (size, size)} if size else {}
            planes = ["coverage", "instance"]
            return scene.render("cam", planes=planes, spp=1024, filter="box", **options)

        yield render


def moments(image):
    """Centroid (x, y) and variances of an image about it, in pixels; y up."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    weight = image / image.sum()
    x, y = (weight * columns).sum(), (weight * rows).sum()
    return (x, y), ((weight * (columns - x) ** 2).sum(), (weight * (rows - y) ** 2).sum())


@pytest.mark.parametrize("z", [1.2, 1.6, 3.0, 5.0])
@pytest.mark.parametrize("size", [SIDE, 2 * SIDE])
def test_circle_of_confusion(blurred, z, size):
    """The variance of a disc along an axis is its diameter squared / 16; the ball and the pixel add
    theirs: (2 r)^2 / 16 (its silhouette) and 1 / 12."""
    frame = blurred(z, size)
    scale = size / SIDE
    (x, y), variance = moments(frame["coverage"])
    assert abs(x - (size - 1) / 2) < 0.1 * scale and abs(y - (size - 1) / 2) < 0.1 * scale
    own = (2 * RADIUS * FOCAL * scale) ** 2 / 16 + 1 / 12
    diameter = 4 * np.sqrt(np.array(variance) - own)
    expected = FOCAL * scale * APERTURE * abs(1 / z - 1 / FOCUS)
    np.testing.assert_allclose(diameter, expected, rtol=0.02)
    # Planes of fold `centre` see through a pinhole.
    pinhole = (frame["instance"] > 0).sum()
    assert pinhole == pytest.approx(np.pi * (RADIUS * FOCAL * scale) ** 2, rel=0.5, abs=4)


def test_what_lies_in_the_plane_of_focus_is_sharp(blurred):
    sharp = blurred(FOCUS)["coverage"]
    pinhole = blurred(FOCUS, aperture=0.0)["coverage"]
    assert np.abs(sharp - pinhole).max() < 0.1
    assert (sharp > 0).sum() <= 36


@pytest.mark.parametrize("z", [1.2, 5.0])
def test_blades_are_the_shape_of_the_blur(blurred, z):
    """Beyond the plane of focus the aperture is seen upright, before it upside down."""
    turn = 0.4
    image = blurred(z, side=96, aperture=0.3, blades=3, blade_rotation=turn)["coverage"]
    radius = 0.5 * FOCAL * 0.3 * (1 / FOCUS - 1 / z)  # signed
    rows, columns = np.mgrid[:96, :96]
    x, y = columns - 47.5, 47.5 - rows
    inside = np.full(image.shape, -np.inf)
    for edge in range(3):
        middle = turn + 2 * np.pi * (edge + 0.5) / 3 + (np.pi if radius < 0 else 0)
        reach = x * np.cos(middle) + y * np.sin(middle) - abs(radius) * np.cos(np.pi / 3)
        inside = np.maximum(inside, reach)
    soft = 1 + RADIUS * FOCAL
    assert image[inside > soft].sum() < 1e-3 * image.sum()
    core = image[inside < -soft]
    assert core.size > 50
    assert core.std() < 0.3 * core.mean()


def test_an_orthographic_camera_blurs_by_metres(blurred):
    fields = {"projection": "orthographic", "fx": 300.0, "fy": 300.0}
    _, variance = moments(blurred(3.0, **fields)["coverage"])
    own = (2 * RADIUS * 3.0 * 300) ** 2 / 16 + 1 / 12
    diameter = 4 * np.sqrt(np.array(variance) - own)
    np.testing.assert_allclose(diameter, 300 * APERTURE * (3.0 - FOCUS) / FOCUS, rtol=0.02)
