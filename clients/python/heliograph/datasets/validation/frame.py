"""Saved frames that stand alone: .exr or .npz files of Frame.save, without a data set.

Planes as docs/planes.md has them; label columns as docs/python.md has them.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from . import exr, frame_labels, frame_planes
from .files import batches, files
from .formats import Format, Task
from .report import Faults, Malformed

CHECKS = {
    "format": "EXR and .npz files can be read, and have a camera",
    **frame_labels.CHECKS,
    **frame_planes.CHECKS,
}
_OF_ROWS = (
    *("labels", "poses", "corners", "boxes", "visibility", "keypoints", "instance", "masks"),
    *("semantic", "nocs", "object_points"),
)
_BY_ROWS = ("instance", "semantic")  # planes that are compared with rows
_CAMERA, _LABELS, _KEYPOINT = "camera.", "labels.", "keypoint_"
_LOOKED_AT = 16  # files of each kind, until one is a frame's
_HEAD = 1 << 16  # bytes of an EXR, which has its header first


def found(root: Path) -> bool:
    return any(
        _is_frame(path)
        for ending in (".exr", ".npz")
        for path in islice(_alone(root, ending), _LOOKED_AT)
    )


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    paths = [root] if root.is_file() else filter(_is_frame, _alone(root, ".exr", ".npz"))
    for batch in batches(paths, 2):
        yield partial(check_frames, batch)


def _alone(root: Path, *endings: str) -> Iterator[Path]:
    """Files that belong to no data set of EXR frames."""
    of_set = root / "exr" if (root / "labels").is_dir() else None
    return (path for path in files(root, *endings) if of_set not in path.parents)


def _is_frame(path: Path) -> bool:
    try:
        if path.suffix.lower() == ".exr":
            with open(path, "rb") as file:
                return b"heliograph.manifest" in file.read(_HEAD)
        with zipfile.ZipFile(path) as archive:
            return f"{_CAMERA}K.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def check_frames(paths: list[Path], faults: Faults) -> None:
    """Some frames."""
    for path in paths:
        planes, content = _of(path)
        wrong = exr.wrong_content({"instances": [], **content})
        if wrong:
            raise Malformed(path, f"its camera {wrong}")
        if "instances" not in content:
            for check in _OF_ROWS:
                faults.leave(check, "the file has no label rows: save the frame as .npz, too")
            planes = {name: plane for name, plane in planes.items() if name not in _BY_ROWS}
        exr.check_frame(planes, {"instances": [], **content}, path, faults)


def _of_exr(path: Path) -> tuple[dict[str, NdArray], dict[str, Any]]:
    planes = exr.read_planes(path)
    header = exr.read_header(path)
    if "camera" not in header:
        raise Malformed(path, "has no camera in its header: save it with this version")
    return planes, json.loads(header["camera"])


def _of(path: Path) -> tuple[dict[str, NdArray], dict[str, Any]]:
    readers = {".exr": _of_exr, ".npz": _of_npz}
    if path.suffix.lower() not in readers:
        raise Malformed(path, "is no .exr or .npz of Frame.save: name one, or a data set")
    return readers[path.suffix.lower()](path)


def _of_npz(path: Path) -> tuple[dict[str, NdArray], dict[str, Any]]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise Malformed(path, f"is no .npz that can be read ({error}): write it anew") from None
    content: dict[str, Any] = {
        name[len(_CAMERA) :]: arrays.pop(name).tolist()
        for name in list(arrays)
        if name.startswith(_CAMERA)
    }
    columns = {
        name[len(_LABELS) :]: arrays.pop(name) for name in list(arrays) if name.startswith(_LABELS)
    }
    if columns:
        own = {n: c for n, c in columns.items() if not n.startswith(_KEYPOINT)}
        points = {n[len(_KEYPOINT) :]: c for n, c in columns.items() if n.startswith(_KEYPOINT)}
        own.pop("amodal_masks", None)
        content["instances"] = _rows(own, {"category": "category_id"})
        content["keypoints"] = _rows(points, {"instance": "label"})
    return arrays, content


def _rows(columns: dict[str, NdArray], other_names: dict[str, str]) -> list[dict[str, Any]]:
    """A row each, of plain numbers."""
    names = [other_names.get(name, name) for name in columns]
    return [dict(zip(names, row)) for row in zip(*(column.tolist() for column in columns.values()))]


FORMAT = Format(
    "frame", "saved frames", "*.exr or *.npz that Frame.save wrote", CHECKS, found, tasks
)
