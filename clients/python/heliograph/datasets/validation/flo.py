"""Middlebury .flo: optical flow.

Format: Baker et al. 2011; flow-code/README.txt of vision.middlebury.edu/flow.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from .files import any_file, batches, files, picture_size, wanted_count
from .formats import Format, Task
from .report import Faults

CHECKS = {
    "format": "pictures can be read",
    "magic": "a file begins with PIEH, 202021.25 as a little-endian float",
    "size": "width and height, in this order, are those of the picture and fill the file",
    "unknown": "unknown flow is beyond 1e9 in both components, nothing is NaN",
    "range": "flow is in pixels: no more than the picture's size as a rule",
    "pictures": "other-data has frame10.png and frame11.png of each flow10.flo, of one size",
    "counts": "as many flows as images asked for, as many as other-data has",
}


def found(root: Path) -> bool:
    return any_file(root, ".flo")


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = 0
    for batch in batches(files(root, ".flo"), 16):
        count += len(batch)
        yield partial(check_files, root, batch)
    others = {path.parent for path in files(root / "other-data", ".png")}
    for folder in sorted(others):
        name = folder.relative_to(root / "other-data")
        if not (root / "other-gt-flow" / name).is_dir():
            faults.add("counts", folder, "has no flow in other-gt-flow: write it")
    wanted = wanted_count(root)
    if wanted is not None and count != wanted:
        faults.add("counts", root, f"has {count} flows, and the data set {wanted} images")


def check_files(root: Path, paths: list[Path], faults: Faults) -> None:
    """Some files."""
    for path in paths:
        size = _picture(root, path, faults)
        data = path.read_bytes()
        if data[:4] != b"PIEH" or len(data) < 12:
            faults.add("magic", path, f"begins with {data[:4]!r}: needs b'PIEH'")
            continue
        width, height = struct.unpack("<ii", data[4:12])
        if len(data) != 12 + 8 * width * height:
            faults.add(
                "size",
                path,
                f"has {len(data)} bytes: {width}x{height} vectors of float32 need "
                f"{12 + 8 * width * height}",
            )
        elif size and size != (width, height):
            hint = " (width comes first)" if size == (height, width) else ""
            faults.add("size", path, f"is {width}x{height}, its picture {size[0]}x{size[1]}{hint}")
        else:
            flow = np.frombuffer(data, "<f4", offset=12).reshape(-1, 2)
            _check_flow(path, flow.astype(np.float64), max(width, height), faults)


def _picture(root: Path, path: Path, faults: Faults) -> tuple[int, int] | None:
    """The size of the picture that a flow is of; None where the tree is another one."""
    if root / "other-gt-flow" not in path.parents:
        return None
    folder = root / "other-data" / path.parent.relative_to(root / "other-gt-flow")
    sizes = []
    for name in ("frame10.png", "frame11.png"):
        if not (folder / name).is_file():
            faults.add("pictures", folder / name, f"is not there, and {path.name} is: write it")
            return None
        sizes.append(picture_size(folder / name))
    if sizes[0] != sizes[1]:
        faults.add("pictures", folder, f"its pictures are {sizes[0]} and {sizes[1]}: of one size")
    return sizes[0]


def _check_flow(path: Path, flow: np.ndarray, reach: int, faults: Faults) -> None:
    unknown = np.abs(flow) > 1e9
    if np.isnan(flow).any() or (unknown[:, 0] != unknown[:, 1]).any():
        faults.add(
            "unknown",
            path,
            "has NaN, or one unknown component beside a known one: unknown are both, as 1e10",
        )
        return
    known = flow[~unknown[:, 0]]
    typical = float(np.median(np.linalg.norm(known, axis=1))) if len(known) else 0.0
    if typical > reach:
        faults.add(
            "range",
            path,
            f"the flow is {typical:.4g} px as a rule, more than the picture: it is in pixels",
        )


FORMAT = Format("flo", "Middlebury flow", "*.flo", CHECKS, found, tasks)
