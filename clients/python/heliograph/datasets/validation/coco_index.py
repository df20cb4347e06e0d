"""Index of the images and annotations of a COCO file, 40 bytes each. Used by coco.py."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import INTEGER, TEXT, JsonRows, Kind, fields_of
from .report import Faults

Span = tuple[int, int]  # offset and length of a JSON object in its file

_IMAGE = {"id": INTEGER, "file_name": TEXT, "width": INTEGER, "height": INTEGER}
_CATEGORY = {"id": INTEGER, "name": TEXT}
_ANNOTATION = {"id": INTEGER, "image_id": INTEGER, "category_id": INTEGER}
_PANOPTIC = {
    "image_id": INTEGER,
    "file_name": TEXT,
    "segments_info": Kind("a list of objects", lambda v: isinstance(v, list)),
}


@dataclass
class Index:
    """Index of one file of annotations/."""

    path: Path
    categories: dict[int, dict[str, Any]] = field(default_factory=dict)
    images: array[int] = field(default_factory=lambda: array("q"))  # id, offset, length
    annotations: array[int] = field(default_factory=lambda: array("q"))  # image, id, offset, length
    panoptic: bool = False

    def table(self, rows: array[int], columns: int) -> NdArray:
        return np.frombuffer(rows, np.int64).reshape(-1, columns)

    def pieces(self) -> Iterator[tuple[Span, list[Span]]]:
        """Yields every image with its annotations, by image id, then in the file's order."""
        images = self.table(self.images, 3)
        images = images[np.argsort(images[:, 0], kind="stable")]
        rows = self.table(self.annotations, 4)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        starts = np.searchsorted(rows[:, 0], images[:, 0], "left")
        ends = np.searchsorted(rows[:, 0], images[:, 0], "right")
        last = None
        for image, start, end in zip(images, starts, ends):
            again = last == image[0]  # an id that two images have: the first one has the rows
            last = image[0]
            own = rows[start : start if again else end]
            yield (int(image[1]), int(image[2])), [(int(r[2]), int(r[3])) for r in own]


def read_index(path: Path, faults: Faults) -> Index:
    """Reads a file once; adds the faults of its rows, ids and references."""
    index = Index(path)
    category_ids: list[int] = []
    used: set[int] = set()
    rows = JsonRows(path)
    for row in rows:
        if row.key == "images" and _is_good(row.value, _IMAGE, "an image", path, faults):
            index.images.extend((row.value["id"], row.offset, row.length))
        elif row.key == "categories" and _is_good(row.value, _CATEGORY, "a category", path, faults):
            category_ids.append(row.value["id"])
            index.categories[row.value["id"]] = row.value
        elif row.key == "annotations":
            index.panoptic |= isinstance(row.value, dict) and "segments_info" in row.value
            kind = _PANOPTIC if index.panoptic else _ANNOTATION
            if _is_good(row.value, kind, "an annotation", path, faults):
                number = 0 if index.panoptic else row.value["id"]
                index.annotations.extend((row.value["image_id"], number, row.offset, row.length))
                used.add(row.value.get("category_id", -1))
    for key in ("images", "categories", "annotations"):
        if key not in rows.keys:
            faults.add("format", path, f"has no {key}: needs images, categories and annotations")
    _check_ids(index, category_ids, faults)
    _check_references(index, used - {-1}, faults)
    return index


def _is_good(row: Any, kind: dict[str, Kind], what: str, path: Path, faults: Faults) -> bool:
    wrong = fields_of(row, kind)
    if wrong:
        name = row.get("id", "?") if isinstance(row, dict) else "?"
        faults.add("format", path, f"{what} (id {name}) {wrong}")
    return not wrong


def _check_ids(index: Index, category_ids: list[int], faults: Faults) -> None:
    images = index.table(index.images, 3)[:, 0]
    columns = {"image": images, "category": np.array(category_ids, np.int64)}
    if not index.panoptic:
        columns["annotation"] = index.table(index.annotations, 4)[:, 1]
    for what, ids in columns.items():
        values, times = np.unique(ids, return_counts=True)
        for value, count in zip(values[times > 1], times[times > 1]):
            faults.add(
                "ids", index.path, f"{what} id {value} is there {count} times: number them uniquely"
            )
        lowest = 0 if what == "image" else 1
        for value in values[values < lowest]:
            why = "; pycocotools takes 0 for no match" if what == "annotation" else ""
            faults.add("ids", index.path, f"{what} id {value}: ids start at {lowest}{why}")


def _check_references(index: Index, used: set[int], faults: Faults) -> None:
    images = index.table(index.images, 3)[:, 0]
    wanted = index.table(index.annotations, 4)[:, 0]
    for missing in np.unique(wanted[~np.isin(wanted, images)]):
        faults.add(
            "references",
            index.path,
            f"annotations name image {missing}, and there is none: add it, or take them out",
        )
    for number in sorted(used - set(index.categories)):
        faults.add(
            "references",
            index.path,
            f"annotations name category {number}, and there are {sorted(index.categories)}: add it",
        )
