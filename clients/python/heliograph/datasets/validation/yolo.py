"""YOLO: boxes, segments and poses as Ultralytics reads them.

Format: https://docs.ultralytics.com/datasets/detect, /segment, /pose.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..._wire.arrays import NdArray
from .files import PICTURES, batches, files, picture_size, read_yaml, wanted_count
from .formats import Format, Task
from .masks import polygon_area
from .report import Faults, Malformed

CHECKS = {
    "format": "labels are lines of numbers, pictures can be read",
    "data": "data.yaml has train, val and names from 0; nc and kpt_shape agree with them",
    "counts": "each picture has a label file, an empty one without objects, and each label file "
    "its picture",
    "fields": "5 numbers a box, 1 + 2 n a segment (n >= 3), 5 + keypoints a pose, one kind a set",
    "classes": "the class is a whole number from 0, and names has it",
    "range": "coordinates are shares of width and height, within 0 to 1",
    "bbox": "a box has a width and a height and is within the picture",
    "segment": "an outline encloses something",
    "keypoints": "v is 0, 1 or 2, and 0 at 0, 0",
    "duplicates": "no line is there twice",
}
_WITHIN = 1e-4  # files with four decimals and more


@dataclass(frozen=True)
class _Set:
    """data.yaml. keypoints: (count, numbers of each), or None."""

    path: Path
    folders: list[Path]
    classes: int
    keypoints: tuple[int, int] | None


def found(root: Path) -> bool:
    return (root / "data.yaml").is_file() and (root / "labels").is_dir()


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    data = _read_data(root, faults)
    if data is None:
        return
    kinds: set[str] = set()
    count = 0
    for folder in data.folders:
        labels = _labels_of(root, folder)
        pictures = {path.relative_to(folder).with_suffix("") for path in files(folder, *PICTURES)}
        texts = {path.relative_to(labels).with_suffix("") for path in files(labels, ".txt")}
        count += len(pictures)
        for name in sorted(texts - pictures):
            faults.add("counts", labels / f"{name}.txt", "has no picture: write it, or remove this")
        for name in sorted(pictures - texts):
            faults.add(
                "counts",
                labels / f"{name}.txt",
                "is not there: of a picture without objects it is empty",
            )
        for names in batches(sorted(texts & pictures), 64):
            paths = [labels / f"{name}.txt" for name in names]
            kinds |= {kind for path in paths for kind in _kinds(path, data)}
            yield partial(check_labels, paths, data)
        for names in batches(sorted(pictures), 64):
            yield partial(check_pictures, folder, names)
    if len(kinds) > 1:
        faults.add(
            "fields", data.path, f"its labels have {' and '.join(sorted(kinds))}: needs one kind"
        )
    wanted = wanted_count(root)
    if wanted is not None and count != wanted:
        faults.add("counts", root, f"has {count} pictures, and the data set {wanted} images")


def _read_data(root: Path, faults: Faults) -> _Set | None:
    path = root / "data.yaml"
    data = read_yaml(path)
    names = data.get("names")
    listed = list(names) if isinstance(names, list) else list((names or {}).values())
    keys = (
        [str(k) for k in names] if isinstance(names, dict) else [str(i) for i in range(len(listed))]
    )
    shape = data.get("kpt_shape")
    wrong = ""
    if not listed or keys != [str(i) for i in range(len(listed))]:
        wrong = f"names is {names!r:.80}: needs a name of each class, from 0"
    elif "nc" in data and data["nc"] != len(listed):
        wrong = f"nc is {data['nc']}, and names has {len(listed)}: of one number"
    elif shape is not None and (
        not isinstance(shape, list) or len(shape) != 2 or shape[1] not in (2, 3)
    ):
        wrong = f"kpt_shape is {shape!r}: needs [keypoints, 2 or 3]"
    folders: list[Path] = []
    base = root / str(data.get("path", ""))
    for key in ("train", "val", "test", *(k for k in data if k not in _KNOWN)):
        value = data.get(key)
        if value is None and key in ("train", "val"):
            wrong = wrong or f"has no {key}: needs the folder of its pictures"
        for name in value if isinstance(value, list) else [value] if isinstance(value, str) else ():
            folder = (base if os.path.isdir(base) else root) / name
            if os.path.isdir(folder) and folder not in folders:
                folders.append(folder)
            elif not os.path.isdir(folder) and key in ("train", "val", "test"):
                wrong = wrong or f"{key} is {name}, which is no folder here"
    if wrong:
        faults.add("data", path, wrong)
        return None
    keypoints = (int(shape[0]), int(shape[1])) if shape else None
    return _Set(path, folders, len(listed), keypoints)


_KNOWN = ("path", "train", "val", "test", "names", "nc", "kpt_shape", "kpt_names", "flip_idx")


def _labels_of(root: Path, folder: Path) -> Path:
    """Ultralytics' img2label_paths: the last `images` of the path becomes `labels`."""
    parts = list(folder.relative_to(root).parts)
    places = [i for i, part in enumerate(parts) if part == "images"]
    if not places:
        raise Malformed(folder, "has no folder `images` in its path: labels are looked for by it")
    parts[places[-1]] = "labels"
    return root.joinpath(*parts)


def _kinds(path: Path, data: _Set) -> set[str]:
    """Kinds of labels in a file, by the number of fields of its lines."""
    lengths = {len(line.split()) for line in path.read_text().splitlines()}
    if data.keypoints:
        return {"poses"} if lengths else set()
    return {"boxes" if length == 5 else "segments" for length in lengths}


def check_pictures(folder: Path, names: list[Path], faults: Faults) -> None:
    """Can they be read?"""
    for name in names:
        for ending in PICTURES:
            if (folder / f"{name}{ending}").is_file():
                picture_size(folder / f"{name}{ending}")


def check_labels(paths: list[Path], data: _Set, faults: Faults) -> None:
    """Some label files."""
    for path in paths:
        seen: set[str] = set()
        for number, line in enumerate(path.read_text().splitlines(), 1):
            _check_line(_Line(path, number, faults), line.split(), data)
            if line in seen:
                faults.add("duplicates", path, f"line {number} was there before: remove it")
            seen.add(line)


@dataclass(frozen=True)
class _Line:
    path: Path
    number: int
    faults: Faults

    def fault(self, check: str, message: str) -> None:
        self.faults.add(check, self.path, f"line {self.number}: {message}")


def _check_line(line: _Line, words: list[str], data: _Set) -> None:
    try:
        values = np.array(words[1:], float)
        kind = int(words[0])
    except (ValueError, IndexError):
        line.fault("classes", f"begins with {words[:1]}: the class is a whole number")
        return
    if not 0 <= kind < data.classes:
        line.fault(
            "classes", f"class {kind}: names has 0 to {data.classes - 1}; classes start at 0"
        )
    count = len(values)
    if data.keypoints:
        points, each = data.keypoints
        if count != 4 + points * each:
            line.fault("fields", f"has {count + 1} numbers: a pose has {5 + points * each}")
            return
        if _check_box(line, values[:4]):
            _check_keypoints(line, values[4:].reshape(points, each))
    elif count == 4:
        _check_box(line, values)
    elif count < 6 or count % 2:
        line.fault("fields", f"has {count + 1} numbers: a box has 5, a segment 1 + 2 n, n >= 3")
    elif _in_range(line, values) and polygon_area(values.reshape(-1, 2)) <= 0:
        line.fault("segment", "its outline encloses nothing: leave it out")


def _in_range(line: _Line, values: NdArray) -> bool:
    good = bool(
        np.isfinite(values).all() and (values >= -_WITHIN).all() and (values <= 1 + _WITHIN).all()
    )
    if not good:
        shown = [round(float(v), 4) for v in values[:6]]
        line.fault("range", f"has {shown}: divide by the picture's width and height")
    return good


def _check_box(line: _Line, values: NdArray) -> bool:
    if not _in_range(line, values):
        return False
    center, size = values[:2], values[2:]
    if (
        (size <= 0).any()
        or (center - size / 2 < -_WITHIN).any()
        or (center + size / 2 > 1 + _WITHIN).any()
    ):
        line.fault(
            "bbox",
            f"{values.tolist()}: needs the centre, then a width and height that stay within 0 to 1",
        )
    return True


def _check_keypoints(line: _Line, points: NdArray) -> None:
    if points.shape[1] == 2:
        _in_range(line, points.ravel())
        return
    for i, (x, y, v) in enumerate(points.tolist()):
        if v not in (0, 1, 2):
            line.fault("keypoints", f"keypoint {i}: v is {v:g}: needs 0, 1 or 2")
        elif v == 0 and (x or y):
            line.fault("keypoints", f"keypoint {i}: v is 0 at {x:g}, {y:g}: needs 0, 0")
        elif v:
            _in_range(line, np.array([x, y]))


FORMAT = Format("yolo", "YOLO", "data.yaml and labels/", CHECKS, found, tasks)
