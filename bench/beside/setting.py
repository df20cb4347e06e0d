"""Setting of every renderer: a ball, its lights, a camera; and the measures of a picture.

Used by the three renderers' scripts and by tests/image/test_materials_beside_peers.py. numpy only.
World: right-handed, Z up, metres. The camera is orthographic and looks along +Y, so that a ring of
the picture is one angle to the normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

SIZE = 64  # pixels, square
HALF_VIEW = 1.1  # metres from the middle of the picture to its edge; the ball's radius is 1
RINGS = 6  # of equal width: 7, 15, 24, 35, 47 and 63 degrees to the normal on average
DISC = 1 - 2 * HALF_VIEW / SIZE  # radius that is measured: a pixel less than the ball's
SPOT_DEGREES = (0, 6, 12, 20, 30, 45, 60)  # of the normal to the half vector of lamp and camera
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
MAX_DEPTH = 40  # path edges: a hundredth of the light is left in rough glass of index 2
SEGMENTS = 128  # of the ball
CORE = 0.9995  # radius of the ball below a surface that is looked at alone
LAMP_SIDE, LAMP_DISTANCE = 2.0, 5.0  # metres
LAMP_RADIANCE = math.pi * LAMP_DISTANCE**2 / LAMP_SIDE**2  # a surface that faces it gets about pi


def _direction(x: float, y: float, z: float) -> np.ndarray:
    return np.array([x, y, z]) / math.sqrt(x * x + y * y + z * z)


VIEW = np.array([0.0, -1.0, 0.0])  # from the ball to the camera
LAMPS = {
    "lamp": _direction(-0.5 * math.sqrt(1.5), -0.5, 0.5 * math.sqrt(1.5)),  # 60 degrees from VIEW
    "back": _direction(0.4, 0.82, 0.4),
}


@dataclass(frozen=True)
class Light:
    """dome: radiance of the sky. lamp: a key of LAMPS, or none. inside: the ball is a bubble of
    air, seen from within the material about it. core: radiance of an opaque black ball right below
    the surface; None: no such ball. With it a picture shows what a single surface does."""

    dome: float
    lamp: str = ""
    inside: bool = False
    core: float | None = None


LIGHTS = {
    "dome": Light(1),
    "lamp": Light(0, "lamp"),
    "back": Light(0, "back"),
    "reflects": Light(1, core=0),
    "refracts": Light(0, core=1),
    "reflects inside": Light(1, inside=True, core=0),
    "refracts outwards": Light(0, inside=True, core=1),
}


def ball(radius: float = 1, inwards: bool = False) -> dict[str, np.ndarray]:
    """Positions, normals, uvs (u around +Z) and triangles, counter-clockwise from outside."""
    rows, columns = SEGMENTS // 2, SEGMENTS
    v, u = (x.ravel() for x in np.mgrid[0 : rows + 1, 0 : columns + 1])
    theta, phi = math.pi * v / rows, 2 * math.pi * u / columns
    normals = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)], axis=-1
    )
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    above = first + columns + 1
    lower = np.stack([first, first + 1, above + 1], axis=-1)[columns:]  # none at the pole below
    upper = np.stack([first, above + 1, above], axis=-1)[:-columns]
    faces = np.concatenate([lower, upper])
    return {
        "positions": (radius * normals).astype("f4"),
        "normals": (-normals if inwards else normals).astype("f4"),
        "uvs": np.stack([u / columns, v / rows], axis=-1).astype("f4"),
        "indices": (faces[:, ::-1] if inwards else faces).astype("u4"),
    }


def lamp_pose(name: str) -> np.ndarray:
    """Matrix of a square about the origin in x and y that faces +Z, put where the lamp is."""
    z = -LAMPS[name]
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = LAMP_DISTANCE * LAMPS[name]
    return pose


def camera_pose() -> np.ndarray:
    """Looks along its -Z, +Y up."""
    pose = np.eye(4)
    pose[:3, :3] = np.stack([[1, 0, 0], [0, 0, 1], [0, -1, 0]], axis=1)
    pose[:3, 3] = 4 * VIEW
    return pose


def _normals() -> np.ndarray:
    """(SIZE, SIZE, 3) of the ball at the middles of the pixels; NaN beside the disc."""
    steps = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * HALF_VIEW
    x, z = np.meshgrid(steps, -steps)
    squared = x * x + z * z
    y = -np.sqrt(np.where(squared < DISC**2, 1 - squared, np.nan))
    return np.stack([x, y, z], axis=-1)


def _masks() -> dict[str, np.ndarray]:
    normals = _normals()
    radius = np.hypot(normals[..., 0], normals[..., 2])
    inside = ~np.isnan(normals[..., 1])
    ring = np.floor(radius / DISC * RINGS)
    masks = {f"ring {k}": inside & (ring == k) for k in range(RINGS)}
    half = LAMPS["lamp"] + VIEW
    angle = np.degrees(np.arccos(np.clip(normals @ half / np.linalg.norm(half), -1, 1)))
    for low, high in zip(SPOT_DEGREES, SPOT_DEGREES[1:], strict=False):
        masks[f"spot {low}-{high}"] = inside & (angle >= low) & (angle < high)
    return {"disc": inside, **masks}


MASKS = _masks()
STATISTICS = ("red", "green", "blue", *MASKS)


def statistics(picture: np.ndarray) -> np.ndarray:
    """Statistics of a picture (SIZE, SIZE, 3) in the order of STATISTICS: colour of the disc, and
    mean luminances."""
    light = picture.astype("f8") @ LUMINANCE
    means = [float(light[mask].mean()) for mask in MASKS.values()]
    return np.array([*picture[MASKS["disc"]].mean(0, dtype="f8"), *means])


def wanted(light: str) -> list[str]:
    """Names of the statistics that are meaningful under a light."""
    return [s for s in STATISTICS if light == "lamp" or not s.startswith("spot")]


def mean_and_error(chunks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error of independent pictures' statistics (N, ...)."""
    return chunks.mean(0), chunks.std(0, ddof=1) / math.sqrt(len(chunks))


def measure(picture_of: Any, chunks: int) -> dict[str, np.ndarray]:
    """picture_of(seed): an independent picture. Statistics of each, and the mean picture."""
    pictures = [np.asarray(picture_of(seed))[..., :3] for seed in range(1, chunks + 1)]
    return {
        "statistics": np.array([statistics(p) for p in pictures]),
        "picture": np.mean(pictures, axis=0, dtype="f8").astype("f4"),
    }
