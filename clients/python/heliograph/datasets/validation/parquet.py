"""Parquet tables of labels: images, instances, keypoints.

Columns as docs/datasets.md has them; file format: https://parquet.apache.org.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._optional import pyarrow
from ..._wire.arrays import NdArray
from . import frame_labels
from .files import batches, check_size, wanted_count
from .formats import Format, Task
from .frame_labels import Shot, check_labels
from .report import Faults, Malformed

CHECKS = {
    "format": "tables can be read, and have their columns with their types",
    "ids": "an index is there once in images.parquet, a label once an index in instances.parquet",
    "references": "instances and keypoints have an index that images.parquet has",
    "counts": "indices are from 0 without gaps, as many as images asked for",
    "image_files": "a file that is named is there and has width and height",
    **frame_labels.CHECKS,
}
_COLUMNS = {
    "images": ("index", "width", "height", "K", "camera_from_world_cv"),
    "instances": ("index", "label", "world_from_object", "camera_from_object_cv"),
    "keypoints": ("index", "label", "name", "position_camera", "image", "state"),
}
_IMAGES = 256  # a task


def found(root: Path) -> bool:
    return (root / "images.parquet").is_file() and (root / "instances.parquet").is_file()


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    tables = {name: root / f"{name}.parquet" for name in _COLUMNS}
    indices = {}
    for name, path in tables.items():
        if path.is_file():
            _check_columns(path, _COLUMNS[name])
            indices[name] = _column(path, "index")
    images = indices["images"]
    values, times = np.unique(images, return_counts=True)
    for value in values[times > 1]:
        faults.add("ids", tables["images"], f"index {value} is there {times.max()} times: once")
    if len(values) and (values[0] != 0 or values[-1] != len(values) - 1):
        missing = np.setdiff1d(np.arange(values[-1]), values)
        faults.add("counts", tables["images"], f"lacks index {missing[:1]}: 0 to {values[-1]}")
    wanted = wanted_count(root)
    if wanted is not None and len(values) != wanted:
        faults.add("counts", root, f"has {len(values)} images, and the data set {wanted}")
    for name in ("instances", "keypoints"):
        for index in np.setdiff1d(indices.get(name, values), values)[:3]:
            faults.add(
                "references", tables[name], f"has index {index}, which images.parquet has not"
            )
    for batch in batches(values.tolist(), _IMAGES):
        yield partial(check_images, root, batch[0], batch[-1], [n for n in indices])


def _check_columns(path: Path, needed: tuple[str, ...]) -> None:
    try:
        names = pyarrow().parquet.read_schema(path).names
    except (OSError, ValueError) as error:
        raise Malformed(path, f"is no Parquet that can be read ({error}): write it") from None
    missing = [name for name in needed if name not in names]
    if missing:
        raise Malformed(path, f"has no column {missing[0]}: it has {names}")


def _column(path: Path, name: str) -> NdArray:
    table = pyarrow().parquet.read_table(path, columns=[name])
    return np.asarray(table[name].to_numpy()).astype(np.int64)


def check_images(root: Path, first: int, last: int, names: list[str], faults: Faults) -> None:
    """Images of some indices, both included, with their instances and keypoints."""
    arrow = pyarrow()
    span = [("index", ">=", first), ("index", "<=", last)]
    rows = {
        name: arrow.parquet.read_table(root / f"{name}.parquet", filters=span).to_pylist()
        for name in names
    }
    by_image: dict[str, dict[int, list[Any]]] = {"instances": {}, "keypoints": {}}
    for name, table in by_image.items():
        for row in rows.get(name, ()):
            table.setdefault(row["index"], []).append(row)
    for row in rows["images"]:
        index = row["index"]
        if row.get("file"):
            size = row["width"], row["height"]
            check_size(faults, "image_files", root / row["file"], size, f"images.parquet, {index},")
        instances = by_image["instances"].get(index, [])
        doubled = [k for k, n in Counter(r["label"] for r in instances).items() if n > 1]
        if doubled:
            faults.add(
                "ids",
                root / "instances.parquet",
                f"image {index}: label {doubled[0]} is there twice",
            )
            continue
        report = partial(_report, faults, root / "instances.parquet", index)
        check_labels(
            Shot(row, report, faults.leave), instances, by_image["keypoints"].get(index, [])
        )


def _report(faults: Faults, path: Path, index: int, check: str, message: str) -> None:
    faults.add(check, path, f"image {index}: {message}")


FORMAT = Format("parquet", "Parquet", "images.parquet and instances.parquet", CHECKS, found, tasks)
