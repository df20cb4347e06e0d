"""Clean EXR frames by the package OpenEXR, and faults to plant in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenEXR
from clean_frames import frame, labels
from frame_faults import LABEL_FAULTS, PLANE_FAULTS
from shapes_seen import HEIGHT, WIDTH
from shapes_seen import write_json as put


def parts_of(planes: dict[str, np.ndarray]) -> list[OpenEXR.Part]:
    """A part a plane, channels RGBA or XYZ or the plane's name."""
    parts = []
    for name, data in planes.items():
        names = "RGBA" if name == "beauty" else "XYZ"
        if data.ndim == 2:
            channels = {name.partition(":")[0]: np.ascontiguousarray(data)}
        else:
            channels = {names[i]: np.ascontiguousarray(data[..., i]) for i in range(data.shape[2])}
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        parts.append(OpenEXR.Part(header, channels, name))
    return parts


def save(path: Path, planes: dict[str, np.ndarray]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    OpenEXR.File(parts_of(planes)).write(str(path))


def make(root: Path) -> None:
    for i in range(2):
        save(root / f"exr/{i:06d}.exr", frame())
        put(root / f"labels/{i:06d}.json", labels(i))


def planted(change):
    """Writes the first frame anew."""

    def plant(root: Path) -> None:
        planes, content = frame(), json.loads((root / "labels/000000.json").read_text())
        change(planes, content)
        save(root / "exr/000000.exr", planes)
        put(root / "labels/000000.json", content)

    return plant


FAULTS = {
    "EXR is none": ("exr.format", lambda root: (root / "exr/000000.exr").write_bytes(b"v/1\x01")),
    "EXR cut": (
        "exr.format",
        lambda root: (root / "exr/000000.exr").write_bytes(
            (root / "exr/000000.exr").read_bytes()[:-900]
        ),
    ),
    "JSON without K": ("exr.format", planted(lambda planes, content: content.pop("K"))),
    "width and height swapped": (
        "exr.sizes",
        planted(lambda planes, content: content.update(width=HEIGHT, height=WIDTH)),
    ),
    "JSON removed": ("exr.counts", lambda root: (root / "labels/000001.json").unlink()),
    "frame removed": ("exr.counts", lambda root: (root / "exr/000001.exr").unlink()),
    **{
        name: (f"exr.{check}", planted(change))
        for name, (check, change) in (LABEL_FAULTS | PLANE_FAULTS).items()
    },
}
