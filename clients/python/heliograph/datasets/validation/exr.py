"""Saved frames: EXR files of planes, with label rows beside them.

Planes as docs/planes.md has them, rows as docs/python.md has label columns.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._optional import openexr
from ..._wire.arrays import NdArray
from . import frame_labels, frame_planes
from .files import INTEGER, LIST, batches, fields_of, files, numbers, read_object, wanted_count
from .formats import Format, Task
from .frame_labels import Shot, check_labels
from .frame_planes import Planes
from .report import Faults, Malformed

CHECKS = {
    "format": "EXR files and labels/*.json can be read and have their fields",
    "counts": "each EXR has its JSON, each JSON its EXR, as many as images asked for",
    **frame_labels.CHECKS,
    **frame_planes.CHECKS,
}
SHOT = {
    "width": INTEGER,
    "height": INTEGER,
    "K": LIST,
    "camera_from_world_cv": LIST,
    "instances": LIST,
}
_READING = threading.Lock()


def found(root: Path) -> bool:
    return next(files(root / "exr", ".exr"), None) is not None


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    pairs = []
    for folder, ending, other, name in (
        ("exr", ".exr", "labels", ".json"),
        ("labels", ".json", "exr", ".exr"),
    ):
        for path in files(root / folder, ending):
            twin = (root / other / path.relative_to(root / folder)).with_suffix(name)
            if not twin.is_file():
                faults.add("counts", twin, f"is not there, and {path.name} is: write both")
            elif folder == "exr":
                pairs.append((path, twin))
    for batch in batches(pairs, 2):
        yield partial(check_frames, batch)
    wanted = wanted_count(root)
    if wanted is not None and len(pairs) != wanted:
        faults.add("counts", root, f"has {len(pairs)} frames, and the data set {wanted} images")


def check_frames(pairs: list[tuple[Path, Path]], faults: Faults) -> None:
    """Some EXR files with their JSON files."""
    for path, twin in pairs:
        content = read_object(twin)
        wrong = wrong_content(content)
        if wrong:
            raise Malformed(twin, wrong)
        check_frame(read_planes(path), content, path, faults)


def wrong_content(content: dict[str, Any]) -> str:
    """Fault of the fields of a label file; "" when there is none."""
    wrong = fields_of(content, SHOT)
    sizes = {"K": (3, 3), "camera_from_world_cv": (4, 4)}
    for name, (rows, columns) in sizes.items():
        if not wrong and not (
            len(content[name]) == rows and all(map(numbers(columns).holds, content[name]))
        ):
            wrong = f"{name} needs {rows} rows of {columns} numbers"
    return wrong


def check_frame(
    planes: dict[str, NdArray], content: dict[str, Any], path: Path, faults: Faults
) -> None:
    """Planes and label rows of one frame."""
    for name in [n for n, plane in planes.items() if plane.dtype == np.float16 and n != "beauty"]:
        base = name.partition(":")[0]
        coarse = f"{name} is float16, too coarse to be compared"
        faults.leave(base if base in frame_planes.CHECKS else "projection", coarse)
        del planes[name]
    shot = Shot(content, partial(_report, faults, path), faults.leave)
    rows = {row["label"]: row for row in content["instances"] if "label" in row}
    if Planes(planes, shot, rows).check():
        check_labels(shot, content["instances"], content.get("keypoints", []))


def _report(faults: Faults, path: Path, check: str, message: str) -> None:
    faults.add(check, path, message)


def read_header(path: Path) -> dict[str, Any]:
    """Header of an EXR's first part."""
    with _READING:
        found: dict[str, Any] = openexr().File(str(path), header_only=True).header()
    return found


def read_planes(path: Path) -> dict[str, NdArray]:
    """The parts of an EXR: (H, W) or (H, W, C)."""
    library = openexr()
    output = io.StringIO()  # the only report of pixels that cannot be decoded
    try:
        with _READING, contextlib.redirect_stdout(output):
            parts = library.File(str(path), separate_channels=True).parts
    except (RuntimeError, ValueError, TypeError) as error:
        raise Malformed(path, f"is no EXR that can be read ({error}): write it anew") from None
    if "Exception" in output.getvalue():
        first = output.getvalue().splitlines()[0]
        raise Malformed(path, f"has pixels that cannot be read ({first}): write it anew")
    planes = {}
    for part in parts:
        channels = {name: channel.pixels for name, channel in part.channels.items()}
        if len(channels) == 1:
            planes[part.name()] = next(iter(channels.values()))
        else:
            order = "RGBA" if "R" in channels else "XYZW"
            planes[part.name()] = np.stack([channels[n] for n in order if n in channels], axis=-1)
    return planes


FORMAT = Format("exr", "EXR frames", "exr/*.exr", CHECKS, found, tasks)
