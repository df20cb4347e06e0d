"""Cameras that make no sense, through the Python client: one row each."""

import heliograph as hg
import numpy as np
import pytest
from refusals import camera, check, entity

INVALID = hg.InvalidArgument

# Row -> (error, field, what else the message says, call).
CAMERAS = {
    "aperture": (INVALID, "camera.aperture", "0, 1000", entity(camera=camera(aperture=-0.01))),
    "no focus": (INVALID, "camera.focus_distance", "1e-06", entity(camera=camera(aperture=0.01))),
    "fisheye blur": (
        INVALID,
        "camera.aperture",
        "perspective and orthographic",
        entity(camera=camera(projection="fisheye", aperture=0.01, focus_distance=1)),
    ),
    "two blades": (INVALID, "camera.blades", "3, 64", entity(camera=camera(blades=2))),
    "near": (INVALID, "camera.near", "0, 1e", entity(camera=camera(near=-1))),
    "near beyond far": (INVALID, "camera.far", "beyond near", entity(camera=camera(near=2, far=1))),
    "3 coefficients": (
        INVALID,
        "camera.distortion",
        "k1 k2 p1 p2",
        entity(camera=camera(distortion=(0.1, 0, 0))),
    ),
    "14 coefficients": (
        INVALID,
        "camera.distortion",
        "prisms",
        entity(camera=camera(distortion=np.ones(14))),
    ),
    "5 fisheye coefficients": (
        INVALID,
        "camera.distortion",
        "k1 k2 k3 k4",
        entity(camera=camera(projection="fisheye", distortion=np.zeros(5))),
    ),
    "distorted panorama": (
        INVALID,
        "camera.distortion",
        "leave it out",
        entity(camera=camera(projection="equirectangular", distortion=(1, 0, 0, 0))),
    ),
    "coefficient": (
        INVALID,
        "camera.distortion[1]",
        "-1e+06",
        entity(camera=camera(distortion=(0, 1e7, 0, 0))),
    ),
    "fov": (INVALID, "fov", "180", lambda s: hg.Camera.from_fov(0, 32, 24)),
    "fisheye fov": (INVALID, "fov", "above 0", lambda s: hg.Camera.fisheye(-1, 32, 24)),
    "panorama fov": (
        INVALID,
        "fov",
        "above 0",
        lambda s: hg.Camera.equirectangular(32, 24, fov=(1, 0)),
    ),
    "f-number": (
        INVALID,
        "f_number",
        "above 0",
        lambda s: hg.Camera.from_focal_length(50, 32, 24, f_number=0),
    ),
}


@pytest.mark.parametrize("row", CAMERAS)
def test_a_camera_is_refused(world, row):
    kind, field, says, call = CAMERAS[row]
    check(world, call, (kind, field), says)
