"""A clean COLMAP model by arithmetic and OpenCV, and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from clean_nerf import looking
from shapes_seen import HEIGHT, WIDTH, edit_text, picture, quaternion_xyzw

MODEL = "sparse/0"
LENSES = {
    1: ("PINHOLE", [50.0, 51.0, 24.2, 16.3]),
    2: ("OPENCV", [50.0, 51.0, 24.2, 16.3, 0.1, -0.05, 0.002, -0.001]),
    3: ("OPENCV_FISHEYE", [40.0, 40.0, 24.0, 16.0, 0.05, -0.01, 0.002, 0.0]),
}
POINTS = np.random.default_rng(1).uniform(-0.3, 0.3, (9, 3))


def seen(lens: int, points: np.ndarray) -> np.ndarray:
    """By OpenCV, of points in the camera's frame."""
    model, (fx, fy, cx, cy, *k) = LENSES[lens]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    zero = np.zeros(3)
    if model == "OPENCV_FISHEYE":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, K, np.array(k))[0][:, 0]
    return cv2.projectPoints(points, zero, zero, K, np.array(k or [0.0] * 4))[0][:, 0]


def make(root: Path) -> None:
    folder = root / MODEL
    folder.mkdir(parents=True)
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for number, (model, parameters) in LENSES.items():
        lines.append(f"{number} {model} {WIDTH} {HEIGHT} " + " ".join(map(repr, parameters)))
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    tracks: list[list[str]] = [[] for _ in POINTS]
    lines = ["# images"]
    for i in range(3):
        name = f"{i:06d}.png"
        picture(root / "images" / name, i)
        world_from_camera = looking((2 * np.cos(i), 2 * np.sin(i), 0.7)) @ np.diag([1, -1, -1, 1])
        pose = np.linalg.inv(world_from_camera)
        x, y, z, w = quaternion_xyzw(pose[:3, :3])
        numbers = [w, x, y, z, *pose[:3, 3]]
        lines.append(f"{i + 1} {' '.join(repr(float(v)) for v in numbers)} {i + 1} {name}")
        pixels = seen(i + 1, POINTS @ pose[:3, :3].T + pose[:3, 3])
        row = []
        for point, (u, v) in enumerate(pixels):
            if point == 8 and i:
                row.append(f"{u!r} {v!r} -1".replace("np.float64(", "").replace(")", ""))
                continue
            tracks[point].append(f"{i + 1} {point}")
            row.append(f"{float(u)!r} {float(v)!r} {point + 1}")
        lines.append(" ".join(row))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = []
    for point, place in enumerate(POINTS):
        where = " ".join(repr(float(v)) for v in place)
        lines.append(f"{point + 1} {where} 90 90 90 0 {' '.join(tracks[point])}")
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")


def text(file: str, old: str, new: str):
    return lambda root: edit_text(root / MODEL / file, old, new)


def images(change):
    """Edits the words of the first line of image 1."""

    def plant(root: Path) -> None:
        path = root / MODEL / "images.txt"
        lines = path.read_text().splitlines()
        words = lines[1].split()
        change(words)
        path.write_text("\n".join([lines[0], " ".join(words), *lines[2:]]) + "\n")

    return plant


def observed(change):
    """Edits the words of the points of image 1."""

    def plant(root: Path) -> None:
        path = root / MODEL / "images.txt"
        lines = path.read_text().splitlines()
        words = lines[2].split()
        change(words)
        path.write_text("\n".join([*lines[:2], " ".join(words), *lines[3:]]) + "\n")

    return plant


def half_pixel(words) -> None:
    for i in range(0, len(words), 3):
        words[i] = repr(float(words[i]) + 2)


def inverted(words) -> None:
    """Camera to world instead of world to camera."""
    w, x, y, z = map(float, words[1:5])
    words[1:5] = [repr(v) for v in (w, -x, -y, -z)]


def behind(words) -> None:
    words[7] = repr(-float(words[7]))


FAULTS = {
    "one line an image": (
        "colmap.format",
        lambda root: (root / MODEL / "images.txt").write_text(
            "\n".join((root / MODEL / "images.txt").read_text().splitlines()[1::2])
        ),
    ),
    "no points3D.txt": ("colmap.format", lambda root: (root / MODEL / "points3D.txt").unlink()),
    "camera id twice": (
        "colmap.ids",
        text("cameras.txt", "1 PINHOLE", "1 PINHOLE 48 32 50.0 51.0 24.2 16.3\n1 PINHOLE"),
    ),
    "name twice": ("colmap.ids", text("images.txt", "000001.png", "000000.png")),
    "camera of nothing": (
        "colmap.references",
        images(lambda words: words.__setitem__(8, "9")),
    ),
    "point of nothing": (
        "colmap.references",
        observed(lambda words: words.__setitem__(2, "77")),
    ),
    "model of nobody": ("colmap.cameras", text("cameras.txt", "1 PINHOLE", "1 BROWN")),
    "parameter missing": ("colmap.cameras", text("cameras.txt", " -0.001\n", "\n")),
    "quaternion of length 2": (
        "colmap.quaternions",
        images(lambda w: w.__setitem__(slice(1, 5), [repr(2 * float(v)) for v in w[1:5]])),
    ),
    "picture removed": ("colmap.image_files", lambda root: (root / "images/000001.png").unlink()),
    "picture of another size": (
        "colmap.image_files",
        lambda root: picture(root / "images/000001.png", 1, (HEIGHT, WIDTH)),
    ),
    "observation in no track": ("colmap.tracks", text("points3D.txt", " 1 0 2 0", " 2 0")),
    "looks away": ("colmap.behind", images(behind)),
    "camera to world": ("colmap.reprojection", images(inverted)),
    "observations two pixels off": ("colmap.reprojection", observed(half_pixel)),
    "image missing": (
        "colmap.counts",
        lambda root: [
            (root / ".heliograph").mkdir(),
            (root / ".heliograph/dataset.json").write_text('{"count": 4}'),
        ],
    ),
}
