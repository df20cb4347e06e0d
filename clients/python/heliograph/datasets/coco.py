"""COCO: instances, keypoints and panoptic segmentation.

Format: https://cocodataset.org/#format-data, checked against pycocotools 2.0.11.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import FailedPrecondition
from . import rle
from .writer import Dataset, Image, Picture, Records, Writer


class Coco(Writer):
    """DIR/images/000123.png and DIR/annotations/instances.json; with splits images/train/... and
    annotations/instances_train.json.

    An annotation for each instance that has a category and a visible pixel: bbox is that of its
    visible pixels, area their number, segmentation their mask as compressed RLE. Category ids are
    the scene's class ids, image ids the indices, annotation ids count from 1. A picture without
    instances has no annotation. Further keys: `instance` (the label), `name`.
    """

    labels = ("boxes",)

    def __init__(
        self, directory: str | os.PathLike[str], *, picture: Picture | str | None = None
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = (*self.picture.planes, "instance")

    def begin(self, dataset: Dataset) -> None:
        if not dataset.categories:
            raise FailedPrecondition(
                "COCO needs categories, and the scene has none: give entities category=..."
            )
        super().begin(dataset)

    def write(self, image: Image) -> Any:
        file = self.put_picture(image)
        frame = image.frame
        return {
            "file_name": file.rpartition("/")[2],
            "width": frame.width,
            "height": frame.height,
            "annotations": list(annotations_of(image)),
        }

    def finish(self, records: Records) -> None:
        for split in self.dataset.splits or ("",):
            name = f"instances_{split}.json" if split else "instances.json"
            chosen = records.of_split(split)
            with self.file(f"annotations/{name}") as path, open(path, "w") as file:
                file.write('{"info": {"description": "made by heliograph"},\n"licenses": [],\n')
                file.write(f'"categories": {json.dumps(self._categories())},\n"images": [')
                write_rows(file, (image_of(index, record) for index, record in chosen))
                file.write('],\n"annotations": [')
                write_rows(file, numbered(chosen))
                file.write("]}\n")

    def _categories(self) -> list[dict[str, Any]]:
        return [
            {"id": number, "name": name, "supercategory": ""}
            for number, name in sorted(self.dataset.categories.items())
        ]


def annotations_of(image: Image) -> Iterator[dict[str, Any]]:
    """One for each visible instance with a category, without its id and image_id."""
    labels, frame = image.frame.labels, image.frame
    runs = rle.runs_of_ids(frame["instance"])
    for row in np.flatnonzero((labels["category"] > 0) & (labels["visible"] > 0)):
        x0, y0, x1, y1 = (int(v) for v in labels["bbox_visible"][row])
        counts = runs[int(labels["label"][row])]
        yield {
            "category_id": int(labels["category"][row]),
            "iscrowd": 0,
            "bbox": [x0, y0, x1 - x0, y1 - y0],
            "area": int(labels["visible"][row]),
            "segmentation": {
                "size": [frame.height, frame.width],
                "counts": rle.compressed(counts),
            },
            "instance": int(labels["label"][row]),
            "name": str(labels["name"][row]),
        }


def image_of(index: int, record: Mapping[str, Any]) -> dict[str, Any]:
    """An entry of `images`."""
    return {"id": index, **{key: record[key] for key in ("file_name", "width", "height")}}


def numbered(records: Records) -> Iterator[dict[str, Any]]:
    """All annotations with their ids, from 1: an id of 0 is no detection to pycocotools."""
    number = 0
    for index, record in records:
        for annotation in record["annotations"]:
            number += 1
            yield {"id": number, "image_id": index, **annotation}


def write_rows(file: Any, rows: Iterator[Any]) -> None:
    """The items of a JSON array, a line each."""
    for i, row in enumerate(rows):
        file.write((",\n" if i else "\n") + json.dumps(row, separators=(",", ":")))
