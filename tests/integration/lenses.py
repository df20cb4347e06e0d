"""A second opinion on cameras: their formulas in numpy float64, no code of the renderer.

Points are in the OpenCV camera frame; images are K coordinates (integers are pixel centres).
"""

from __future__ import annotations

import heliograph as hg
import numpy as np

WIDTH, HEIGHT = 320, 240
K = np.array([[250.0, 0, 163.3], [0, 243.0, 115.9], [0, 0, 1]])


def image_of(camera: hg.Camera, points: np.ndarray) -> np.ndarray:
    """K coordinates of points (N, 3); nan for what is not in front of a flat image plane."""
    x, y, z = np.asarray(points, float).T
    k = np.zeros(8)
    k[: len(camera.distortion)] = camera.distortion
    if camera.projection == "perspective":
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = np.where(z > 0, x / z, np.nan), np.where(z > 0, y / z, np.nan)
        # https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html
        k1, k2, p1, p2, k3, k4, k5, k6 = k
        r2 = a**2 + b**2
        radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        m = np.stack(
            [
                a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a**2),
                b * radial + p1 * (r2 + 2 * b**2) + 2 * p2 * a * b,
            ],
            -1,
        )
    elif camera.projection == "fisheye":
        # https://docs.opencv.org/4.x/db/d58/group__calib3d__fisheye.html
        theta = np.arccos(z / np.sqrt(x**2 + y**2 + z**2))
        bent = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
        m = bent[:, None] * np.stack([x, y], -1) / np.hypot(x, y)[:, None]
    elif camera.projection == "equirectangular":
        m = np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], -1)
    else:
        m = np.stack([x, y], -1)
    return m * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def direction_at(camera: hg.Camera, pixels: np.ndarray) -> np.ndarray:
    """Unit directions that image_of() takes to pixels (N, 2): Newton's method on its numerical
    derivatives, from the direction of a pinhole (fisheye: of an equidistant lens)."""
    m = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    if camera.projection == "equirectangular":
        lon, lat = m.T
        return np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], -1)
    polar = camera.projection == "fisheye"

    def direction(q: np.ndarray) -> np.ndarray:
        if not polar:
            d = np.concatenate([q, np.ones((len(q), 1))], -1)
        else:
            theta = np.linalg.norm(q, axis=1, keepdims=True)
            d = np.concatenate([q / theta * np.sin(theta), np.cos(theta)], -1)
        return d / np.linalg.norm(d, axis=1, keepdims=True)

    q = m.copy()
    h = 1e-6
    for _ in range(40):
        at = image_of(camera, direction(q))
        dx = (image_of(camera, direction(q + [h, 0])) - at) / h
        dy = (image_of(camera, direction(q + [0, h])) - at) / h
        step = np.linalg.solve(np.stack([dx, dy], -1), (pixels - at)[..., None])[..., 0]
        q += np.clip(step, -0.3, 0.3)
    assert np.abs(image_of(camera, direction(q)) - pixels).max() < 1e-6
    return direction(q)


def lens(projection: str, *distortion: float, scale: float = 1.0) -> hg.Camera:
    k = K.copy()
    k[:2, :2] *= scale
    return hg.Camera.from_intrinsics(k, WIDTH, HEIGHT, projection=projection, distortion=distortion)


# Lenses of calibrated cameras, a wide one of each kind, and the ideal ones.
LENSES = {
    "pinhole": lens("perspective"),
    "orthographic": lens("orthographic", scale=0.12),
    "barrel": lens("perspective", -0.28, 0.07, 0.0009, -0.0006, 0.004),
    "pincushion": lens("perspective", 0.21, -0.05, 0.001, 0.002),
    "rational": lens("perspective", 0.8, -0.3, 0.0005, -0.001, 0.04, 1.1, -0.2, 0.03),
    "fisheye": lens("fisheye", -0.03, 0.006, -0.004, 0.0006, scale=0.33),
    "wide fisheye": lens("fisheye", scale=0.28),
    "panorama": hg.Camera.equirectangular(WIDTH, WIDTH // 2),
    "part of a panorama": hg.Camera.equirectangular(WIDTH, HEIGHT, fov=(2.0, 1.4)),
}
