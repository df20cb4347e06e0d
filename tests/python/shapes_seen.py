"""Contents of the clean data sets of the validator's tests: pictures and masks by arithmetic."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 48, 32


def disc(x: float, y: float, radius: float) -> np.ndarray:
    """(H, W) bool."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return (columns - x) ** 2 + (rows - y) ** 2 <= radius**2


def masks(image: int) -> list[np.ndarray]:
    """Two discs, the second one behind the first, as far as they are seen."""
    first, second = disc(12.3 + image, 10.2, 6.1), disc(18.4 + image, 14.6, 7.7)
    return [first, second & ~first]


def picture(path: Path, image: int, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((size[1], size[0], 3), 40 + 20 * image, np.uint8)
    Image.fromarray(pixels).save(path)


def edit_json(path: Path, change) -> None:
    """Reads a JSON file, lets `change` have its content, writes what it returns or that."""
    content = json.loads(path.read_text())
    changed = change(content)
    path.write_text(json.dumps(content if changed is None else changed))


def edit_text(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text, (old, text[:400])
    path.write_text(text.replace(old, new, 1))


def edit_picture(path: Path, change) -> None:
    """Reads a picture, lets `change` have the array, writes it."""
    pixels = np.array(Image.open(path))
    changed = change(pixels)
    Image.fromarray(pixels if changed is None else changed).save(path)


def write_json(path: Path, content) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


# ------------------------------------------------------------ a solid thing before a camera

K = np.array([[60.0, 0, 23.4], [0, 61.0, 15.8], [0, 0, 1]])
BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * (0.12, 0.07, 0.05)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = [t for a, b, c, d in QUADS for t in ([a, b, c], [a, c, d])]


def turned(axis, angle: float) -> np.ndarray:
    """(3, 3) by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion_xyzw(rotation: np.ndarray) -> list[float]:
    """Quaternion of a rotation by less than half a turn."""
    w = np.sqrt(1 + np.trace(rotation)) / 2
    r = rotation
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4 * w)
    return [*axis.tolist(), float(w)]


def rasterised(points: np.ndarray, pad: int = 0) -> np.ndarray:
    """(H, W) depth of the box with these corners in an OpenCV camera, inf beside it; with `pad`
    images more on each side."""
    rows, columns = np.mgrid[-pad * HEIGHT : (1 + pad) * HEIGHT, -pad * WIDTH : (1 + pad) * WIDTH]
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(K).T
    depth = np.full(rows.shape, np.inf)
    for triangle in TRIANGLES:
        corners = points[triangle]
        weights = rays @ np.linalg.inv(corners)  # of the corners, for the point of depth 1
        total = weights.sum(-1)
        hit = (weights >= 0).all(-1) & (total > 0)
        depth[hit] = np.minimum(depth[hit], 1 / total[hit])
    return depth


# Two boxes of one kind: the first one hides some of the second, which leaves the image.
POSES = [
    (turned((1, 2, 3), 0.7), np.array([-0.03, 0.01, 0.65])),
    (turned((3, -1, 1), 1.1), np.array([0.18, 0.05, 0.75])),
]


def placed(image: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotations and translations in metres."""
    return [(turned((0, 0, 1), 0.2 * image) @ r, t + (0.01 * image, 0, 0)) for r, t in POSES]
