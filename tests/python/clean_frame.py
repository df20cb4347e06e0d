"""Clean frames that stand alone, as Frame.save writes them, and faults to plant in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenEXR
from clean_exr import parts_of
from clean_frames import frame, labels
from frame_faults import LABEL_FAULTS, PLANE_FAULTS
from shapes_seen import HEIGHT, WIDTH

_NOT_OF_CAMERA = ("instances", "keypoints", "index", "split", "camera")


def camera_of(content: dict) -> dict:
    return {name: value for name, value in content.items() if name not in _NOT_OF_CAMERA}


def columns(rows: list[dict], prefix: str = "") -> dict[str, np.ndarray]:
    return {f"labels.{prefix}{name}": np.array([row[name] for row in rows]) for name in rows[0]}


def save_npz(path: Path, planes: dict[str, np.ndarray], content: dict) -> None:
    rows = [
        {("category" if k == "category_id" else k): v for k, v in row.items() if k != "category"}
        for row in content["instances"]
    ]
    points = [
        {("instance" if k == "label" else k): v for k, v in row.items()}
        for row in content["keypoints"]
    ]
    named = {f"camera.{name}": np.array(value) for name, value in camera_of(content).items()}
    np.savez(path, **planes, **columns(rows), **columns(points, "keypoint_"), **named)


def save_exr(path: Path, planes: dict[str, np.ndarray], content: dict) -> None:
    parts = parts_of(planes)
    parts[0].header["manifest"] = '{"format": "heliograph.manifest.v1"}'
    parts[0].header["camera"] = json.dumps(camera_of(content))
    OpenEXR.File(parts).write(str(path))


def make(root: Path) -> None:
    root.mkdir(parents=True)
    save_npz(root / "a.npz", frame(), labels(0))
    save_exr(root / "b.exr", frame(), labels(0))


def planted(change):
    """Writes a frame anew."""

    def plant(root: Path, name: str = "a.npz") -> None:
        planes, content = frame(), labels(0)
        change(planes, content)
        (save_npz if name.endswith(".npz") else save_exr)(root / name, planes, content)

    return plant


def cut(name: str):
    return lambda root: (root / name).write_bytes((root / name).read_bytes()[:-900])


FAULTS = {
    "EXR cut": ("frame.format", cut("b.exr")),
    "no K": (
        "frame.format",
        lambda root: planted(lambda planes, content: content.pop("K"))(root, "b.exr"),
    ),
    "depth of an EXR in millimetres": (
        "frame.depth",
        lambda root: planted(PLANE_FAULTS["depth in millimetres"][1])(root, "b.exr"),
    ),
    "width and height swapped": (
        "frame.sizes",
        planted(lambda planes, content: content.update(width=HEIGHT, height=WIDTH)),
    ),
    **{
        name: (f"frame.{check}", planted(change))
        for name, (check, change) in (LABEL_FAULTS | PLANE_FAULTS).items()
    },
}
