"""The planes of sensors: statistics of a frame's noise, holes, reproducibility, refusals."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import pose
from refusals import NAN, camera, check, entity, render

SIZE = (160, 120)
FULL_WELL, READ_NOISE = 4000, 5
RGB = hg.RgbSensor(full_well=FULL_WELL, read_noise=READ_NOISE, black_level=0.05)
STEREO = hg.DepthSensor(baseline=0.08, disparity_noise=0.2, min_signal=1e-4)


def eye(**fields):
    return hg.Camera.from_fov(50, *SIZE, degrees=True, **fields)


@pytest.fixture(scope="module")
def wall(client):
    """A grey wall at 2 m under a uniform sky, with a pane of glass at 1.5 m."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=(0.3, 0.4, 0.5))
            edit.mesh("plane", **hg.shapes.plane(1))
            edit.material("grey", base_color=0.5, specular=0, roughness=1)
            edit.material("glass", **hg.materials.glass)
            edit.entity("wall", mesh="plane", material="grey", transform=pose((0, 0, -2), scale=4))
            glass = pose((0.3, 0, -1.5), scale=0.3)
            edit.entity("pane", mesh="plane", material="glass", transform=glass)
            edit.entity("cam", camera=eye(rgb_sensor=RGB, depth_sensor=STEREO))
        yield scene


def test_colour_noise_has_the_moments_of_its_formula(client):
    """A sky alone: every pixel has the same signal. 5 standard deviations of the estimates."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=(0.1, 0.4, 0.8))
            edit.entity("cam", camera=eye(rgb_sensor=RGB))
        frame = scene.render("cam", planes=["sensor_rgb", "beauty"], spp=1)
        again = scene.rerender(frame.manifest)
        other = scene.render("cam", planes=["sensor_rgb"], spp=1, seed=1)
        assert scene["cam"].camera.rgb_sensor == RGB
    np.testing.assert_array_equal(frame["sensor_rgb"], again["sensor_rgb"])
    assert (frame["sensor_rgb"] != other["sensor_rgb"]).mean() > 0.9
    pixels = frame["sensor_rgb"].reshape(-1, 3).astype(float)
    signal = frame["beauty"].reshape(-1, 4)[0, :3].astype(float)
    mean = 0.05 + 0.95 * signal
    variance = 0.95**2 * (signal / FULL_WELL + (READ_NOISE / FULL_WELL) ** 2)
    count = len(pixels)
    assert (np.abs(pixels.mean(0) - mean) < 5 * np.sqrt(variance / count)).all()
    assert (np.abs(pixels.var(0) - variance) < 5 * variance * np.sqrt(2 / count)).all()


def test_a_mosaic_and_its_picture_come_from_the_same_photosites(wall):
    with wall.branch() as scene:
        with scene.edit() as edit:
            bayer = hg.RgbSensor(full_well=900, bits=10, pattern="gbrg")
            edit.update("cam", camera=eye(rgb_sensor=bayer))
        assert scene["cam"].camera.rgb_sensor == bayer
        frame = scene.render("cam", planes=["sensor_mosaic", "sensor_rgb", "beauty"], spp=4)
    mosaic, rgb = frame["sensor_mosaic"], frame["sensor_rgb"]
    assert mosaic.shape == SIZE[::-1] and rgb.shape == (*mosaic.shape, 3)
    np.testing.assert_array_equal(mosaic * 1023, np.round(mosaic * 1023))
    for channel, y, x in ((1, 0, 0), (2, 0, 1), (0, 1, 0), (1, 1, 1)):
        np.testing.assert_array_equal(rgb[y::2, x::2, channel], mosaic[y::2, x::2])
        exact = frame["beauty"][y::2, x::2, channel].astype(float)
        score = (mosaic[y::2, x::2] - exact) / np.sqrt(exact / 900 + 1 / 12 / 1023**2)
        assert abs(score.std() - 1) < 5 / np.sqrt(2 * score.size)


def test_depth_noise_and_holes(wall):
    planes = ["sensor_depth", "depth", "transmission"]
    frame = wall.render("cam", planes=planes)
    measured, depth = frame["sensor_depth"].astype(float), frame["depth"].astype(float)
    glass = frame["transmission"] > 0.5
    assert glass.sum() > 100
    np.testing.assert_array_equal(measured == 0, glass)
    ok = ~glass
    noise = depth[ok] ** 2 / (eye().fx * 0.08) * 0.2
    score = (measured - depth)[ok] / noise
    assert abs(score.std() - 1) < 5 / np.sqrt(2 * ok.sum()) + 0.02
    assert abs(score.mean()) < 0.1


def test_a_panorama_is_measured_whole(scene):
    """From the middle of a white ball of 3 m, behind the camera too."""
    ball = hg.shapes.sphere(3.0, segments=64)
    with scene.edit() as edit:
        white = edit.material("white", base_color=1.0)
        edit.entity("ball", mesh=edit.mesh("ball", **ball), material=white)
        sensor = hg.DepthSensor("time_of_flight", range_noise=0.0)
        lens = hg.Camera.equirectangular(64, 32, depth_sensor=sensor)
        edit.entity("cam", camera=lens)
    frame = scene.render("cam", planes=["sensor_depth", "distance"])
    np.testing.assert_allclose(frame["sensor_depth"], frame["distance"], rtol=1e-6)
    assert np.abs(frame["distance"] - 3).max() < 0.02


def test_eyes_of_a_rig_have_noise_of_their_own(wall):
    with wall.edit() as edit:
        both = hg.RgbSensor(full_well=1000)
        hg.stereo(edit, "rig", camera=eye(rgb_sensor=both), baseline=1e-6, transform=np.eye(4))
    left, right = wall.render(["rig/left", "rig/right"], planes=["sensor_rgb", "depth"], spp=1)
    np.testing.assert_allclose(left["depth"], right["depth"], atol=1e-4)
    assert (left["sensor_rgb"] != right["sensor_rgb"]).mean() > 0.9


def sensed(**fields):
    return entity(camera=camera(**fields))


REFUSED = {
    "rgb plane": ("planes", "rgb_sensor", render(planes=["sensor_rgb"])),
    "mosaic plane": ("planes", "pattern", render(planes=["sensor_mosaic"])),
    "pattern": (
        "rgb_sensor.pattern",
        "rggb",
        sensed(rgb_sensor=hg.RgbSensor(pattern="bayer")),
    ),
    "depth plane": ("planes", "depth_sensor", render(planes=["sensor_depth"])),
    **{
        f"rgb {name}": (
            f"rgb_sensor.{name}",
            "",
            sensed(rgb_sensor=hg.RgbSensor(**{"full_well": 10, name: value})),
        )
        for name, value in {
            "exposure": 65,
            "full_well": -1,
            "read_noise": NAN,
            "black_level": 1,
            "bits": 17,
            "vignetting": 1.5,
        }.items()
    },
    "read noise alone": (
        "rgb_sensor.full_well",
        "read_noise",
        sensed(rgb_sensor=hg.RgbSensor(read_noise=1)),
    ),
    **{
        f"depth {name}": (
            f"depth_sensor.{name}",
            "",
            sensed(depth_sensor=hg.DepthSensor(**{"baseline": 0.1, name: value})),
        )
        for name, value in {
            "kind": "lidar",
            "baseline": 0,
            "disparity_noise": -1,
            "disparity_step": NAN,
            "lateral_noise": 17,
            "range_noise": 0.1,
            "window": 4,
            "min_signal": -1,
            "max_angle": 2,
            "min_depth": -1,
            "max_depth": -1,
        }.items()
    },
    "range": (
        "depth_sensor.max_depth",
        "min_depth",
        sensed(depth_sensor=hg.DepthSensor(baseline=0.1, min_depth=2, max_depth=1)),
    ),
    "stereo through a fisheye": (
        "depth_sensor.kind",
        "perspective",
        sensed(projection="fisheye", depth_sensor=STEREO),
    ),
    "stereo through distortion": (
        "depth_sensor.kind",
        "perspective",
        sensed(distortion=(0.1, 0, 0, 0), depth_sensor=STEREO),
    ),
    "baseline of time of flight": (
        "depth_sensor.baseline",
        "stereo",
        sensed(depth_sensor=hg.DepthSensor("time_of_flight", baseline=0.1)),
    ),
    "orthographic": (
        "depth_sensor.kind",
        "orthographic",
        sensed(projection="orthographic", depth_sensor=hg.DepthSensor("time_of_flight")),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_sensor_is_refused(world, name):
    field, message, call = REFUSED[name]
    kind = hg.FailedPrecondition if field == "planes" else hg.InvalidArgument
    check(world, call, (kind, field), message)
