"""YOLO: boxes, segments or poses as Ultralytics reads them.

Format: https://docs.ultralytics.com/datasets/detect, /segment and /pose.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import FailedPrecondition, InvalidArgument
from ..writer import Dataset, Image, Picture, Records, Writer
from .keypoints import OUTSIDE, VISIBLE, Keypoints, Skeleton, skeletons_of
from .outlines import joined, outlines

_TASKS = ("box", "seg", "pose")


class Yolo(Writer):
    """DIR/images/000123.png, DIR/labels/000123.txt and DIR/data.yaml; with splits images/train/ and
    labels/train/.

    A line for each instance that has a category and a visible pixel, coordinates divided by the
    image's width and height, 0 at the outer edge of the first pixel: the class from 0 and, of task
    "box", the centre and size of the box of its visible pixels; of "seg" the corners of its outline
    along the pixels' edges, parts and holes joined to one; of "pose" the box, then x, y, v of each
    keypoint, v as in COCO. "pose" has the classes with keypoints alone. An image without instances
    has an empty file.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        task: str = "box",
        picture: Picture | str = "png",
    ) -> None:
        if task not in _TASKS:
            raise InvalidArgument(f"task: one of {', '.join(_TASKS)}, not {task!r}", field="task")
        super().__init__(directory, picture=picture)
        self.task = task
        self.planes = (*self.picture_planes, *(("instance",) if task == "seg" else ()))
        self.labels = ("boxes", "keypoints") if task == "pose" else ("boxes",)
        self._classes: list[int] = []
        self._skeletons: dict[int, Skeleton] = {}

    def begin(self, dataset: Dataset) -> None:
        super().begin(dataset)
        if not dataset.categories:
            raise FailedPrecondition(
                "YOLO needs categories, and the scene has none: give entities category=..."
            )
        self._classes = sorted(dataset.categories)
        if self.task == "pose":
            self._skeletons = skeletons_of(dataset)
            self._classes = sorted(self._skeletons)
            counts = {len(skeleton.names) for skeleton in self._skeletons.values()}
            if len(counts) > 1:
                raise FailedPrecondition(
                    "YOLO poses have as many keypoints in every class; "
                    + ", ".join(
                        f"{dataset.categories[c]} has {len(self._skeletons[c].names)}"
                        for c in self._classes
                    )
                )

    def write(self, image: Image) -> Any:
        file = self.put_picture(image)
        frame, labels = image.frame, image.frame.labels
        place = {category: k for k, category in enumerate(self._classes)}
        points = Keypoints(labels) if self.task == "pose" else None
        lines = []
        for row in np.flatnonzero(labels["visible"] > 0):
            category = int(labels["category"][row])
            if category not in place:
                continue
            if self.task == "seg":
                numbers = _segment(frame, int(labels["label"][row]), labels["bbox_visible"][row])
            else:
                numbers = _box(frame, labels["bbox_visible"][row])
            line = f"{place[category]} {_text(numbers)}"
            if points is not None:
                label = int(labels["label"][row])
                line += _pose(frame, *points.of(label, self._skeletons[category]))
            lines.append(line + "\n")
        name = "labels" + file[len("images") :].rpartition(".")[0] + ".txt"
        self.put(name, "".join(lines))
        return {"file": file, "instances": len(lines)}

    def finish(self, records: Records) -> None:
        import yaml

        splits = self.dataset.splits
        data: dict[str, Any] = {str(split): f"images/{split}" for split in splits}
        if not splits:
            data = {"train": "images", "val": "images"}
        elif "val" not in splits:
            data["val"] = f"images/{splits[-1]}"
        data["names"] = {k: str(self.dataset.categories[c]) for k, c in enumerate(self._classes)}
        if self.task == "pose":
            names = {
                k: list(map(str, self._skeletons[c].names)) for k, c in enumerate(self._classes)
            }
            data |= {"kpt_shape": [len(names[0]), 3], "kpt_names": names}
        self.put("data.yaml", yaml.safe_dump(data, sort_keys=False, allow_unicode=True))


def _text(numbers: NdArray) -> str:
    return " ".join(f"{number:.6f}" for number in numbers.tolist())


def _box(frame: Any, box: NdArray) -> NdArray:
    """(4,) centre and size over width and height."""
    x0, y0, x1, y1 = (float(v) for v in box)
    size = np.array([frame.width, frame.height] * 2)
    return np.asarray(np.array([(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0]) / size)


def _segment(frame: Any, label: int, box: NdArray) -> NdArray:
    """(2 N,) corners over width and height."""
    x0, y0, x1, y1 = (int(v) for v in box)
    outline = joined(outlines(frame["instance"][y0:y1, x0:x1] == label))
    return np.asarray(((outline + np.array([x0, y0])) / (frame.width, frame.height)).ravel())


def _pose(frame: Any, points: NdArray, states: NdArray) -> str:
    """ " x y v" of each keypoint. K coordinates are half a pixel less than raster ones."""
    out = ""
    raster = (points.astype(np.float64) + 0.5) / (frame.width, frame.height)
    for (x, y), state in zip(raster.tolist(), states.tolist()):
        if state == OUTSIDE:
            out += " 0 0 0"
        else:
            out += f" {x:.6f} {y:.6f} {2 if state == VISIBLE else 1}"
    return out
