"""Panoptic segmentation of COCO: PNGs whose colours are ids. Used by coco.py.

Format: https://cocodataset.org/#format-data, "4. Panoptic Segmentation".
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .coco_index import Index, Span
from .files import INTEGER, batches, fields_of, numbers, read_picture
from .formats import Task
from .masks import extent
from .report import Faults

_SEGMENT = {"id": INTEGER, "category_id": INTEGER, "area": INTEGER, "bbox": numbers(4)}


def panoptic_tasks(index: Index, root: Path) -> Iterator[Task]:
    """The pictures of a panoptic file, some a task."""
    stem = index.path.stem
    split = stem.partition("_")[2]
    folders = [index.path.with_suffix(""), root / stem, root / "panoptic" / split]
    rows = index.table(index.annotations, 4)
    spans = [(int(row[2]), int(row[3])) for row in rows]
    for batch in batches(spans, 16):
        yield partial(check_pictures, index.path, batch, folders, set(index.categories))


def check_pictures(
    path: Path, spans: list[Span], folders: list[Path], categories: set[int], faults: Faults
) -> None:
    """Some annotations of a panoptic file."""
    with open(path, "rb") as file:
        for offset, length in spans:
            file.seek(offset)
            row = json.loads(file.read(length))
            where = [folder / row["file_name"] for folder in folders]
            there = next((one for one in where if one.is_file()), None)
            if there is None:
                faults.add(
                    "image_files",
                    where[0],
                    f"is not there, and {path.name} names it for image {row['image_id']}: write it",
                )
                continue
            picture = read_picture(there)
            if picture.ndim != 3 or picture.dtype != np.uint8:
                faults.add("panoptic_ids", there, "is no 8-bit RGB picture: ids are in its colours")
                continue
            _check_segments(row["segments_info"], ids_of(picture), (there, categories), faults)


def ids_of(picture: NdArray) -> NdArray:
    """(H, W) int64 of (H, W, 3) uint8."""
    red, green, blue = (picture[..., i].astype(np.int64) for i in range(3))
    return red + 256 * green + 65536 * blue


def _check_segments(
    segments: list[Any], ids: NdArray, where: tuple[Path, set[int]], faults: Faults
) -> None:
    path, categories = where
    for segment in segments:
        wrong = fields_of(segment, _SEGMENT)
        if wrong:
            faults.add("format", path, f"segments_info: {wrong}")
            return
        if segment["category_id"] not in categories:
            faults.add(
                "references",
                path,
                f"segment {segment['id']} names category {segment['category_id']}, and there are "
                f"{sorted(categories)}: add it",
            )
    listed = [segment["id"] for segment in segments]
    seen = set(np.unique(ids).tolist()) - {0}
    for number in sorted({n for n in listed if listed.count(n) > 1}):
        faults.add("panoptic_ids", path, f"segments_info has {number} more than once")
    for number in sorted(seen - set(listed)):
        faults.add(
            "panoptic_ids",
            path,
            f"has pixels of {number}, which segments_info has not: add it, or make them 0 (void)",
        )
    for segment in segments:
        if segment["id"] not in seen:
            faults.add(
                "panoptic_ids",
                path,
                f"has no pixel of segment {segment['id']}: take it out of segments_info; an id is "
                "R + 256 G + 65536 B",
            )
            continue
        mask = ids == segment["id"]
        x0, y0, x1, y1 = extent(mask)
        if segment["area"] != mask.sum():
            faults.add(
                "panoptic_area",
                path,
                f"segment {segment['id']}: area is {segment['area']}: it has {mask.sum()} pixels",
            )
        if segment["bbox"] != [x0, y0, x1 - x0, y1 - y0]:
            expected = [x0, y0, x1 - x0, y1 - y0]
            faults.add(
                "panoptic_bbox",
                path,
                f"segment {segment['id']}: bbox is {segment['bbox']}: its pixels' is {expected}",
            )
