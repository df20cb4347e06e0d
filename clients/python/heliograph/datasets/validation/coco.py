"""COCO: instances and keypoints; panoptic segmentation is in coco_panoptic.py.

Format: https://cocodataset.org/#format-data; boxes and areas as pycocotools 2.0.11 has them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .coco_index import Index, Span, read_index
from .coco_panoptic import panoptic_tasks
from .files import PICTURES, batches, check_size, files, numbers, wanted_count
from .formats import Format, Task
from .masks import box_of_spans, counts_of, polygon_area, polygon_length, spans_of
from .report import Faults

CHECKS = {
    "format": "files are JSON with images, categories and annotations and their fields",
    "ids": "ids of images, annotations and categories are unique; the latter two start at 1",
    "references": "image_id and category_id name images and categories of the file, "
    "skeletons name keypoints",
    "image_files": "each image's file is there and has its width and height",
    "counts": "as many pictures as images, as many images as the data set was to have",
    "segmentation": "run lengths are of the image's size and fill it, polygons have 3 points or "
    "more within the image, and a mask has a pixel",
    "rle_order": "run lengths go column by column",
    "bbox": "x, y, width, height are the extent of the mask: [0, 0, 1, 1] is the first pixel",
    "area": "area is the number of the mask's pixels",
    "disjoint": "masks of an image share no pixel, crowds apart",
    "keypoints": "x, y, v of each keypoint of the category, v 0, 1 or 2, v 0 at 0, 0, others "
    "within the image; num_keypoints counts v > 0",
    "panoptic_ids": "the ids in a PNG (R + 256 G + 65536 B) are those of segments_info",
    "panoptic_area": "a segment's area is the number of its pixels",
    "panoptic_bbox": "a segment's bbox is the extent of its pixels",
}


def found(root: Path) -> bool:
    return any(_is_coco(path) for path in files(root / "annotations", ".json"))


def _is_coco(path: Path) -> bool:
    with open(path, "rb") as file:
        start = file.read(1 << 16)
    return any(b'"%s"' % key in start for key in (b"images", b"annotations", b"categories"))


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    total = {False: 0, True: 0}
    for path in files(root / "annotations", ".json"):
        index = read_index(path, faults)
        folders = _folders(root, path)
        total[path.stem.startswith("instances")] += len(index.images) // 3
        _check_skeletons(index, faults)
        if index.panoptic:
            yield from panoptic_tasks(index, root)
        else:
            _check_count(index, folders, faults)
        for piece in batches(index.pieces(), 16):
            yield partial(check_images, path, piece, folders, index.categories)
    wanted = wanted_count(root)
    if wanted is not None and total[True] and total[True] != wanted:
        faults.add(
            "counts",
            root / "annotations",
            f"the instances files have {total[True]} images, and the data set has {wanted}: "
            "generate() it to the end",
        )


def _folders(root: Path, path: Path) -> list[Path]:
    """Folders that the pictures of a file of annotations/ may be in: by the split in its name."""
    split = path.stem.rpartition("_")[2] if "_" in path.stem else ""
    named = [root / "images" / split, root / split] if split else []
    return [*named, root / "images", root]


def _check_count(index: Index, folders: list[Path], faults: Faults) -> None:
    folder = next((folder for folder in folders if folder.is_dir()), folders[-1])
    there = sum(path.suffix.lower() in PICTURES for path in folder.iterdir())
    named = len(index.images) // 3
    if there > named:
        faults.add(
            "counts",
            index.path,
            f"has {named} images, and {folder.name} has {there} pictures: a picture without "
            "objects has an entry in images, too",
        )


def _check_skeletons(index: Index, faults: Faults) -> None:
    for number, category in index.categories.items():
        count = len(category.get("keypoints", ()))
        for edge in category.get("skeleton", ()):
            if len(edge) != 2 or not all(1 <= end <= count for end in edge):
                faults.add(
                    "references",
                    index.path,
                    f"category {number}: the skeleton's edge {edge} needs two of 1 to {count}: "
                    "keypoints are counted from 1",
                )


def check_images(
    path: Path,
    pieces: list[tuple[Span, list[Span]]],
    folders: list[Path],
    categories: dict[int, dict[str, Any]],
    faults: Faults,
) -> None:
    """Some images of a file, and their annotations."""
    with open(path, "rb") as file:

        def read(span: Span) -> Any:
            file.seek(span[0])
            return json.loads(file.read(span[1]))

        for image_span, spans in pieces:
            image = read(image_span)
            where = [folder / image["file_name"] for folder in folders]
            there = next((one for one in where if one.is_file()), where[0])
            size = image["width"], image["height"]
            check_size(faults, "image_files", there, size, f"{path.name}, image {image['id']},")
            rows = (read(span) for span in spans)
            _Image(path, image, categories, faults).check(
                row for row in rows if "segments_info" not in row
            )


class _Image:
    """Check of one image: its annotations one by one, and the pixels of their masks. It reads masks
    as runs, which are fewer than pixels."""

    def __init__(
        self, path: Path, image: dict[str, Any], categories: dict[int, Any], faults: Faults
    ) -> None:
        self.path, self.image, self.categories, self.faults = path, image, categories, faults
        self.size = image["height"], image["width"]
        self.covered: list[tuple[dict[str, Any], NdArray]] = []

    def check(self, rows: Iterator[dict[str, Any]]) -> None:
        for row in rows:
            if "segmentation" in row:
                self._shape(row)
            elif "keypoints" not in row:
                self._fault(row, "segmentation", "has no segmentation: give it its mask")
            if "keypoints" in row:
                self._keypoints(row)
        if self.covered:
            self._disjoint()

    def _fault(self, row: dict[str, Any], check: str, message: str) -> None:
        name = f"annotation {row['id']} (image {self.image['id']})"
        self.faults.add(check, self.path, f"{name}: {message}")

    def _shape(self, row: dict[str, Any]) -> None:
        segmentation, box = row["segmentation"], row.get("bbox", [])
        if not numbers(4).holds(box):
            self._fault(row, "bbox", f"bbox is {box!r}: needs [x, y, width, height]")
            return
        if row.get("iscrowd") not in (0, 1):
            self._fault(row, "segmentation", f"iscrowd is {row.get('iscrowd')!r}: needs 0 or 1")
        elif isinstance(segmentation, list):
            self._polygons(row, segmentation, box)
        else:
            self._runs(row, segmentation, box)

    def _runs(self, row: dict[str, Any], segmentation: Any, box: list[float]) -> None:
        if list(segmentation.get("size", ())) != list(self.size):
            self._fault(
                row,
                "segmentation",
                f"size is {segmentation.get('size')}: needs [height, width] {list(self.size)}",
            )
            return
        try:
            spans = spans_of(counts_of(segmentation), self.size)
        except ValueError as error:
            self._fault(row, "segmentation", f"{error}: encode the mask anew")
            return
        if not len(spans):
            self._fault(row, "segmentation", "its mask is empty: leave the annotation out")
            return
        x0, y0, x1, y1 = box_of_spans(spans, self.size[0])
        expected = [x0, y0, x1 - x0, y1 - y0]
        if list(box) != expected:
            y0, x0, y1, x1 = box_of_spans(spans, self.size[1])
            if list(box) == [x0, y0, x1 - x0, y1 - y0]:
                self._fault(
                    row,
                    "rle_order",
                    "bbox fits the run lengths read row by row: COCO's go column by column "
                    "(encode np.asfortranarray(mask))",
                )
                return
            hint = _hint(box, expected)
            self._fault(row, "bbox", f"bbox is {box}: the mask's is {expected}{hint}")
        self._area(row, int((spans[:, 1] - spans[:, 0]).sum()), 0.0)
        if not row["iscrowd"]:
            self.covered.append((row, spans))

    def _polygons(self, row: dict[str, Any], polygons: list[Any], box: list[float]) -> None:
        points = []
        for polygon in polygons:
            good = isinstance(polygon, list) and len(polygon) >= 6 and len(polygon) % 2 == 0
            if not good or not numbers(len(polygon)).holds(polygon):
                self._fault(row, "segmentation", "a polygon needs x, y of 3 points or more")
                return
            points.append(np.reshape(np.array(polygon, float), (-1, 2)))
        every = np.concatenate(points) if points else np.zeros((0, 2))
        if not len(every) or (every < -1e-3).any() or (every > np.array(self.size)[::-1]).any():
            self._fault(row, "segmentation", f"points are within {self.size[1]}x{self.size[0]}")
            return
        low, high = every.min(0), every.max(0)
        expected = [*low, *(high - low)]
        if np.abs(np.array(box) - expected).max() > 1.01:
            shown = [round(float(v), 2) for v in expected]
            self._fault(row, "bbox", f"bbox is {box}: the polygons' is {shown}")
        area = sum(map(polygon_area, points))
        self._area(row, area, sum(map(polygon_length, points)) + 1)

    def _area(self, row: dict[str, Any], expected: float, within: float) -> None:
        area = row.get("area")
        if not isinstance(area, (int, float)) or abs(area - expected) > within:
            self._fault(
                row,
                "area",
                f"area is {area!r}: the mask has {expected:g} pixels (of the mask, not the box)",
            )

    def _disjoint(self) -> None:
        """Sorted by their starts, no run begins before all the earlier ones have ended."""
        spans = np.concatenate([spans for _, spans in self.covered])
        owners = np.repeat(np.arange(len(self.covered)), [len(s) for _, s in self.covered])
        order = np.argsort(spans[:, 0], kind="stable")
        spans, owners = spans[order], owners[order]
        reach = np.maximum.accumulate(spans[:, 1])
        late = np.flatnonzero(spans[1:, 0] < reach[:-1])
        reported: set[frozenset[int]] = set()
        for i in late:
            before = int(owners[: i + 1][spans[: i + 1, 1].argmax()])
            pair = frozenset((before, int(owners[i + 1])))
            if pair in reported:
                continue
            reported.add(pair)
            self._fault(
                self.covered[max(pair)][0],
                "disjoint",
                f"shares pixels with annotation {self.covered[min(pair)][0]['id']}: a pixel "
                "belongs to one instance at most",
            )

    def _keypoints(self, row: dict[str, Any]) -> None:
        names = self.categories.get(row["category_id"], {}).get("keypoints", ())
        given = row["keypoints"]
        if not numbers(3 * len(names)).holds(given):
            self._fault(
                row, "keypoints", f"keypoints needs {3 * len(names)} numbers, x, y, v of {names}"
            )
            return
        points = np.reshape(np.array(given, float), (-1, 3))
        height, width = self.size
        for name, (x, y, v) in zip(names, points.tolist()):
            if v not in (0, 1, 2):
                self._fault(row, "keypoints", f"{name}: v is {v:g}: needs 0, 1 or 2")
            elif v == 0 and (x or y):
                self._fault(row, "keypoints", f"{name}: v is 0 at {x:g}, {y:g}: needs 0, 0")
            elif v and not (-0.5 <= x <= width and -0.5 <= y <= height):
                self._fault(row, "keypoints", f"{name}: {x:g}, {y:g} is outside: needs v 0")
        labelled = int((points[:, 2] > 0).sum())
        if row.get("num_keypoints") != labelled:
            self._fault(
                row,
                "keypoints",
                f"num_keypoints is {row.get('num_keypoints')}: {labelled} have v > 0",
            )


def _hint(box: list[float], expected: list[int]) -> str:
    """Hint at the likely mistake in a box; "" for none."""
    x, y, w, h = expected
    if list(box) == [x, y, w - 1, h - 1]:
        return " (width and height count pixels: last - first + 1)"
    if list(box) in ([x, y, x + w, y + h], [x, y, x + w - 1, y + h - 1]):
        return " (COCO has width and height, not the other corner)"
    return ""


FORMAT = Format(
    "coco", "COCO", "annotations/*.json with images and annotations", CHECKS, found, tasks
)
