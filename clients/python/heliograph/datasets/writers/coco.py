"""COCO: instances, keypoints and panoptic segmentation.

Format: https://cocodataset.org/#format-data, checked against pycocotools 2.0.11.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import FailedPrecondition, InvalidArgument
from ..writer import Dataset, Image, Picture, Records, Writer, encode
from . import rle
from .keypoints import OUTSIDE, VISIBLE, Keypoints, Skeleton, skeletons_of
from .shapes import crowds_in, crowds_of


class Coco(Writer):
    """DIR/images/000123.png and DIR/annotations/instances.json; with splits images/train/... and
    annotations/instances_train.json.

    An annotation for each instance that has a category and a visible pixel: bbox is that of its
    visible pixels, area their number, segmentation their mask as compressed RLE; iscrowd is 1 where
    several entities share a label (group=True). Category ids are the scene's class ids, image ids
    the indices, annotation ids count from 1. Further keys: `instance` (the label), `name`.

    keypoints=True: annotations/keypoints.json too, with the classes that have keypoints: x, y are K
    coordinates, whose integers are pixel centres; v is 2 where seen, 1 where hidden, else 0.
    panoptic=True: annotations/panoptic.json and panoptic/000123.png too. stuff: categories that are
    no countable things: in panoptic.json one segment a category, in the others nothing.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        keypoints: bool = False,
        panoptic: bool = False,
        stuff: Sequence[str] = (),
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.keypoints, self.panoptic, self.stuff = keypoints, panoptic, list(stuff)
        self.planes = (*self.picture_planes, "instance")
        self.labels = ("boxes", "keypoints") if keypoints else ("boxes",)
        self._skeletons: dict[int, Skeleton] = {}
        self._stuff: set[int] = set()
        self._crowds: set[int] = set()

    def begin(self, dataset: Dataset) -> None:
        super().begin(dataset)
        if not dataset.categories:
            raise FailedPrecondition(
                "COCO needs categories, and the scene has none: give entities category=..."
            )
        ids = {name: number for number, name in dataset.categories.items()}
        unknown = [name for name in self.stuff if name not in ids]
        if unknown:
            raise InvalidArgument(
                f"stuff: no category {unknown[0]!r}; there are {', '.join(ids)}", field="stuff"
            )
        self._stuff = {ids[name] for name in self.stuff}
        self._skeletons = skeletons_of(dataset) if self.keypoints else {}
        self._crowds = crowds_of(dataset.scene)

    def write(self, image: Image) -> Any:
        file = self.put_picture(image)
        frame = image.frame
        crowds = crowds_in(image, self._crowds)
        record = {
            "file_name": file.rpartition("/")[2],
            "width": frame.width,
            "height": frame.height,
            "annotations": list(self._annotations(image, crowds)),
        }
        if self.panoptic:
            colors, record["segments"] = panoptic_of(image, self._stuff, crowds)
            name = "/".join(p for p in ("panoptic", image.split, f"{image.name}.png") if p)
            self.put(name, encode(colors))
        return record

    def _annotations(self, image: Image, crowds: set[int]) -> Iterator[dict[str, Any]]:
        points = Keypoints(image.frame.labels) if self.keypoints else None
        for annotation in annotations_of(image, crowds):
            category = annotation["category_id"]
            if category in self._stuff:
                continue
            if points is not None and category in self._skeletons:
                annotation.update(
                    keypoints_of(points.of(annotation["instance"], self._skeletons[category]))
                )
            yield annotation

    def finish(self, records: Records) -> None:
        things = [c for c in self.dataset.categories if c not in self._stuff]
        for split in self.dataset.splits or ("",):
            chosen = records.of_split(split)
            self._put("instances", split, things, (chosen, instances_of(chosen)))
            if self.keypoints:
                rows = with_keypoints_of(chosen)
                self._put("keypoints", split, list(self._skeletons), (chosen, rows))
            if self.panoptic:
                self._put(
                    "panoptic", split, list(self.dataset.categories), (chosen, segments_of(chosen))
                )

    def _put(
        self, kind: str, split: str, categories: Sequence[int], rows: tuple[Records, Iterator[Any]]
    ) -> None:
        """annotations/KIND_SPLIT.json, an image or annotation a line."""
        name = f"annotations/{kind}_{split}.json" if split else f"annotations/{kind}.json"
        listed = json.dumps([self._category(kind, number) for number in sorted(categories)])
        records, annotations = rows
        with self.file(name) as path, open(path, "w") as file:
            file.write('{"info": {"description": "made by heliograph"},\n"licenses": [],\n')
            file.write(f'"categories": {listed},\n"images": [')
            write_rows(file, (image_of(index, record) for index, record in records))
            file.write('],\n"annotations": [')
            write_rows(file, annotations)
            file.write("]}\n")

    def _category(self, kind: str, number: int) -> dict[str, Any]:
        out: dict[str, Any] = {"id": number, "name": self.dataset.categories[number]}
        out["supercategory"] = "stuff" if number in self._stuff else "thing"
        if kind == "panoptic":
            out["isthing"] = int(number not in self._stuff)
        if kind == "keypoints":
            skeleton = self._skeletons[number]
            out["keypoints"] = list(skeleton.names)
            out["skeleton"] = [[a + 1, b + 1] for a, b in skeleton.edges]
        return out


def annotations_of(image: Image, crowds: set[int]) -> Iterator[dict[str, Any]]:
    """Annotation of each visible instance with a category, without its id and image_id. crowds:
    labels of the crowds."""
    labels, frame = image.frame.labels, image.frame
    runs = rle.runs_of_ids(frame["instance"])
    for row in np.flatnonzero((labels["category"] > 0) & (labels["visible"] > 0)):
        x0, y0, x1, y1 = (int(v) for v in labels["bbox_visible"][row])
        label = int(labels["label"][row])
        yield {
            "category_id": int(labels["category"][row]),
            "iscrowd": int(label in crowds),
            "bbox": [x0, y0, x1 - x0, y1 - y0],
            "area": int(labels["visible"][row]),
            "segmentation": {
                "size": [frame.height, frame.width],
                "counts": rle.compressed(runs[label]),
            },
            "instance": label,
            "name": str(labels["name"][row]),
        }


def keypoints_of(seen: tuple[NdArray, NdArray]) -> dict[str, Any]:
    """Keys of the keypoints of an annotation. A point outside the image is 0, 0, 0."""
    flat: list[float] = []
    for (x, y), state in zip(seen[0].tolist(), seen[1].tolist()):
        flat += [0, 0, 0] if state == OUTSIDE else [x, y, 2 if state == VISIBLE else 1]
    return {"num_keypoints": sum(v > 0 for v in flat[2::3]), "keypoints": flat}


def panoptic_of(
    image: Image, stuff: set[int], crowds: set[int]
) -> tuple[NdArray, list[dict[str, Any]]]:
    """((H, W, 3) uint8 of ids R + 256 G + 65536 B, segments_info). A thing's id is its label, stuff
    has that of its first instance; pixels without a category are 0, void."""
    labels, ids = image.frame.labels, image.frame["instance"]
    rows = np.flatnonzero((labels["category"] > 0) & (labels["visible"] > 0))
    numbers = np.zeros(len(rows), dtype="<u4")
    first: dict[int, int] = {}
    segments: dict[int, dict[str, Any]] = {}
    for i, row in enumerate(rows):
        label, category = int(labels["label"][row]), int(labels["category"][row])
        is_thing = category not in stuff
        number = label if is_thing else first.setdefault(category, label)
        numbers[i] = number
        crowd = int(is_thing and label in crowds)
        segment = {"id": number, "category_id": category, "iscrowd": crowd}
        seen = segments.setdefault(number, segment)
        seen["bbox"] = _union(seen.get("bbox"), labels["bbox_visible"][row].tolist())
        seen["area"] = seen.get("area", 0) + int(labels["visible"][row])
    if numbers.size and numbers.max() >= 1 << 24:
        raise InvalidArgument(
            f"label: {numbers.max()} does not fit the 24 bits of a panoptic PNG", field="label"
        )
    merged = np.zeros(ids.shape, dtype="<u4")
    if len(rows):
        own = labels["label"][rows]  # ascending
        place = np.searchsorted(own, ids).clip(max=len(own) - 1)
        merged = np.where(own[place] == ids, numbers[place], merged)
    colors = merged.view(np.uint8).reshape(*ids.shape, 4)[..., :3]
    return colors, list(segments.values())


def _union(box: list[int] | None, corners: list[int]) -> list[int]:
    """x, y, width, height of a box of that form and one of x0, y0, x1, y1."""
    x0, y0, x1, y1 = corners
    if box is not None:
        x0, y0 = min(x0, box[0]), min(y0, box[1])
        x1, y1 = max(x1, box[0] + box[2]), max(y1, box[1] + box[3])
    return [x0, y0, x1 - x0, y1 - y0]


def image_of(index: int, record: Mapping[str, Any]) -> dict[str, Any]:
    """An entry of `images`."""
    return {"id": index, **{key: record[key] for key in ("file_name", "width", "height")}}


def numbered(records: Records) -> Iterator[dict[str, Any]]:
    """Annotations with their ids, from 1: an id of 0 is no detection to pycocotools."""
    number = 0
    for index, record in records:
        for annotation in record["annotations"]:
            number += 1
            yield {"id": number, "image_id": index, **annotation}


def instances_of(records: Records) -> Iterator[dict[str, Any]]:
    """The annotations of instances.json."""
    for annotation in numbered(records):
        yield {k: v for k, v in annotation.items() if k not in ("keypoints", "num_keypoints")}


def with_keypoints_of(records: Records) -> Iterator[dict[str, Any]]:
    """The annotations of keypoints.json: with the ids of instances.json."""
    return (annotation for annotation in numbered(records) if "keypoints" in annotation)


def segments_of(records: Records) -> Iterator[dict[str, Any]]:
    """The annotations of panoptic.json."""
    for index, record in records:
        name = record["file_name"].rpartition(".")[0] + ".png"
        yield {"image_id": index, "file_name": name, "segments_info": record["segments"]}


def write_rows(file: Any, rows: Iterator[Any]) -> None:
    """The items of a JSON array, a line each."""
    for i, row in enumerate(rows):
        file.write((",\n" if i else "\n") + json.dumps(row, separators=(",", ":")))
