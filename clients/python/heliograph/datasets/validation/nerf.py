"""NeRF: transforms.json, as instant-ngp and nerfstudio read it.

Format: https://docs.nerf.studio/quickstart/data_conventions.html: camera to world, OpenGL camera
(x right, y up, looks down -z).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import (
    LIST,
    NUMBER,
    TEXT,
    batches,
    check_size,
    fields_of,
    numbers,
    read_object,
    wanted_count,
)
from .formats import Format, Task
from .geometry import rotation_fault
from .report import Faults, Malformed

CHECKS = {
    "format": "transforms*.json has frames with file_path and transform_matrix",
    "image_files": "each frame's picture is there and has w and h",
    "intrinsics": "fl_x, fl_y, w, h are positive, cx, cy near the picture, camera_angle_x is "
    "2 atan(w / (2 fl_x))",
    "poses": "transform_matrix is 4x4 by rows, rigid, without scale",
    "convention": "cameras look down -z at a common point (OpenGL), not away from it",
    "ids": "file_path names a picture once",
    "counts": "as many frames as images asked for",
}
_FRAME = {"file_path": TEXT, "transform_matrix": LIST}
_LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h")


def found(root: Path) -> bool:
    return any(root.glob("transforms*.json"))


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = 0
    for path in sorted(root.glob("transforms*.json")):
        content = read_object(path)
        wrong = fields_of(content, {"frames": LIST})
        if wrong:
            raise Malformed(path, wrong)
        frames = content.pop("frames")
        count += len(frames)
        named: set[str] = set()
        poses = []
        for i, frame in enumerate(frames):
            wrong = fields_of(frame, _FRAME)
            if wrong:
                faults.add("format", path, f"frames[{i}] {wrong}")
                continue
            if frame["file_path"] in named:
                faults.add("ids", path, f"frames[{i}]: {frame['file_path']} is there twice")
            named.add(frame["file_path"])
            matrix = _pose(path, i, frame, faults)
            if matrix is not None:
                poses.append(matrix)
        _check_convention(path, poses, faults)
        for batch in batches(frames, 64):
            yield partial(check_frames, path, content, batch)
    wanted = wanted_count(root)
    if wanted is not None and count != wanted:
        faults.add("counts", root, f"has {count} frames, and the data set {wanted} images")


def _pose(path: Path, i: int, frame: dict[str, Any], faults: Faults) -> NdArray | None:
    rows = frame["transform_matrix"]
    if len(rows) != 4 or not all(numbers(4).holds(row) for row in rows):
        faults.add("poses", path, f"frames[{i}]: transform_matrix needs 4 rows of 4 numbers")
        return None
    matrix = np.array(rows, float)
    wrong = rotation_fault(matrix[:3, :3])
    if not wrong and np.abs(matrix[3] - (0, 0, 0, 1)).max() > 1e-6:
        wrong = f"ends in {matrix[3].tolist()}: needs 0, 0, 0, 1 (it is by rows)"
    if wrong:
        faults.add("poses", path, f"frames[{i}] ({frame['file_path']}): {wrong}")
        return None
    return matrix


def _check_convention(path: Path, poses: list[NdArray], faults: Faults) -> None:
    """Checks that the point nearest to the optical axes of all cameras is before the cameras."""
    if len(poses) < 3:
        return
    origins = np.stack([pose[:3, 3] for pose in poses])
    axes = np.stack([-pose[:3, 2] for pose in poses])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(0)
    if np.linalg.eigvalsh(total)[0] < 0.05 * len(poses):
        return  # they look the same way: no such point
    point = np.linalg.solve(total, np.einsum("nij,nj->i", across, origins))
    away = point - origins
    along = (away * axes).sum(1)
    beside = np.linalg.norm(away - along[:, None] * axes, axis=1)
    meets = np.median(beside / np.maximum(np.linalg.norm(away, axis=1), 1e-12)) < 0.35
    if meets and (along < 0).mean() > 0.8:
        faults.add(
            "convention",
            path,
            f"{int((along < 0).sum())} of {len(poses)} cameras look away from the point that they "
            "have in common: turn y and z of OpenCV cameras round",
        )


def check_frames(
    path: Path, shared: dict[str, Any], frames: list[dict[str, Any]], faults: Faults
) -> None:
    """Intrinsics and pictures of some frames."""
    for frame in frames:
        if fields_of(frame, _FRAME):
            continue  # a fault of the format already
        lens = {**shared, **frame}
        name = frame["file_path"]
        wrong = _wrong_lens(lens)
        if wrong:
            faults.add("intrinsics", path, f"{name}: {wrong}")
        picture = path.parent / name
        if not picture.suffix and not picture.is_file():
            picture = picture.with_suffix(".png")  # the synthetic scenes leave it out
        size = (lens["w"], lens["h"]) if {"w", "h"} <= set(lens) else None
        if size is not None or not picture.is_file():
            check_size(faults, "image_files", picture, size or (0, 0), path.name)


def _wrong_lens(lens: dict[str, Any]) -> str:
    if "fl_x" not in lens and "camera_angle_x" not in lens:
        return "has neither fl_x nor camera_angle_x: needs one"
    given = {key: NUMBER for key in (*_LENS, "camera_angle_x") if key in lens}
    wrong = fields_of(lens, given)
    if wrong:
        return wrong
    for key in ("fl_x", "fl_y", "w", "h"):
        if lens.get(key, 1) <= 0:
            return f"{key} is {lens[key]}: needs > 0"
    for key, size in (("cx", "w"), ("cy", "h")):
        if {key, size} <= set(lens) and not -lens[size] <= lens[key] <= 2 * lens[size]:
            return f"{key} is {lens[key]:g}, far outside {size} {lens[size]}: write it in pixels"
    if {"fl_x", "w", "camera_angle_x"} <= set(lens):
        angle = 2 * math.atan(lens["w"] / (2 * lens["fl_x"]))
        if abs(angle - lens["camera_angle_x"]) > 1e-3:
            return f"camera_angle_x is {lens['camera_angle_x']:g}: fl_x and w say {angle:.6g} rad"
    return ""


FORMAT = Format("nerf", "NeRF", "transforms*.json", CHECKS, found, tasks)
