"""Cameras and tracks that make no sense, through the Python client: one row each."""

import heliograph as hg
import numpy as np
import pytest
from refusals import camera, check, edited, entity

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
    "near": (INVALID, "camera.near", "1000000000", entity(camera=camera(near=-1))),
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
        "-1000000",
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


def tracked(points, times=(0.0,), camera="cam"):
    return lambda scene: scene.tracks(camera, points, times)


TRACKS = {
    "points": (INVALID, "points", "entity, vertices", tracked(([0], [0], [0], [0]))),
    "columns": (INVALID, "points", "barycentric", tracked({"entity": [1], "primitive": [1]})),
    "lengths": (INVALID, "points", "different lengths", tracked(("ball", [0, 0], [[0, 0]]))),
    "weights": (INVALID, "points.barycentric", r"\(N, 2\)", tracked(("ball", [0], [[0] * 3]))),
    "nan": (INVALID, "points.barycentric", "finite", tracked(("ball", [0], [[0, np.nan]]))),
    "a miss": (
        INVALID,
        "points",
        "nothing was hit",
        tracked({"entity": [0], "primitive": [0], "barycentric": [[0, 0]]}),
    ),
    "times": (INVALID, "times", r"\(N\)", tracked(("ball", [0]), np.zeros((2, 2)))),
    "no times": (INVALID, "times", "at least one", tracked(("ball", [0]), [])),
    "nan time": (INVALID, "times", "finite", tracked(("ball", [0]), [np.nan])),
    "late": (INVALID, "times[1]", "1000000000", tracked(("ball", [0]), [0, 1e10])),
    "camera": (hg.NotFound, "camera", "cam", tracked(("ball", [0]), camera="came")),
    "no camera": (INVALID, "camera", "'ball'", tracked(("ball", [0]), camera="ball")),
    "entity": (hg.NotFound, "entities[0]", "ball", tracked(("balls", [0]))),
    "no mesh": (INVALID, "entities", "no mesh", tracked(("bone", [0]))),
    "triangle": (INVALID, "primitive[1]", "1 triangles", tracked(("ball", [0, 1], [[0, 0]] * 2))),
    "outside": (INVALID, "barycentric[0]", "outside", tracked(("ball", [0], [[0.7, 0.7]]))),
    "vertex": (INVALID, "vertices[1]", "3 vertices", tracked(("ball", [2, 3]))),
    "baseline": (
        INVALID,
        "baseline",
        "above 0",
        edited(lambda e: hg.stereo(e, "rig", camera=camera(), baseline=0)),
    ),
}
TABLES = {
    f"{kind}: {name}": row
    for kind, rows in {"camera": CAMERAS, "track": TRACKS}.items()
    for name, row in rows.items()
}


@pytest.mark.parametrize("name", TABLES)
def test_a_camera_is_refused(world, name):
    kind, field, message, call = TABLES[name]
    check(world, call, (kind, field), message)
