"""A clean transforms.json by arithmetic, and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shapes_seen import HEIGHT, WIDTH, edit_json, picture
from shapes_seen import write_json as put


def looking(eye, at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """(4, 4) camera to world, OpenGL camera, z up."""
    back = np.subtract(eye, at) / np.linalg.norm(np.subtract(eye, at))
    right = np.cross((0, 0, 1), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    pose[:3, 3] = eye
    return pose


def make(root: Path) -> None:
    frames = []
    for i in range(6):
        eye = (2 * np.cos(i), 2 * np.sin(i), 0.5 + 0.2 * i)
        name = f"images/{i:06d}.png"
        picture(root / name, i)
        frames.append({"file_path": name, "transform_matrix": looking(eye).tolist()})
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 50.0, "fl_y": 50.0, "cx": 24.1, "cy": 15.9}
    lens["camera_angle_x"] = float(2 * np.arctan(WIDTH / 100))
    put(root / "transforms.json", {**lens, "camera_model": "PINHOLE", "frames": frames})


def content(change):
    return lambda root: edit_json(root / "transforms.json", lambda c: change(c) and None)


def matrices(change, only: int | None = None):
    def edit(c) -> None:
        for i, frame in enumerate(c["frames"]):
            if only in (None, i):
                frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()

    return content(edit)


FAULTS = {
    "no frames": ("nerf.format", content(lambda c: c.pop("frames"))),
    "frame without file": ("nerf.format", content(lambda c: c["frames"][0].pop("file_path"))),
    "picture removed": (
        "nerf.image_files",
        lambda root: (root / "images/000002.png").unlink(),
    ),
    "w and h swapped": (
        "nerf.image_files",
        lambda root: picture(root / "images/000002.png", 2, (HEIGHT, WIDTH)),
    ),
    "camera_angle_x in degrees": (
        "nerf.intrinsics",
        content(lambda c: c.update(camera_angle_x=51.2)),
    ),
    "focal length as a share": ("nerf.intrinsics", content(lambda c: c.update(fl_x=1.04))),
    "no focal length": (
        "nerf.intrinsics",
        content(lambda c: [c.pop("fl_x"), c.pop("camera_angle_x")]),
    ),
    "matrix by columns": ("nerf.poses", matrices(lambda m: m.T)),
    "matrix with scale": ("nerf.poses", matrices(lambda m: m @ np.diag([2, 2, 2, 1]), 1)),
    "matrix of three rows": ("nerf.poses", matrices(lambda m: m[:3], 3)),
    "OpenCV cameras": ("nerf.convention", matrices(lambda m: m @ np.diag([1, -1, -1, 1]))),
    "a picture twice": (
        "nerf.ids",
        content(lambda c: c["frames"][1].update(file_path="images/000000.png")),
    ),
    "frame missing": (
        "nerf.counts",
        lambda root: [
            (root / ".heliograph").mkdir(),
            (root / ".heliograph/dataset.json").write_text('{"count": 7}'),
        ],
    ),
}
