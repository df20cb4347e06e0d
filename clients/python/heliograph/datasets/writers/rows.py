"""Label columns as rows of plain numbers and texts. Used by the EXR, WebDataset and Parquet
writers."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..writer import Dataset, Image

_MASKS = "amodal_masks"
_KEYPOINT = "keypoint_"


def picture_of(dataset: Dataset, image: Image) -> dict[str, Any]:
    """Values of one image: number, size, time, camera, its lens and its pose."""
    frame = image.frame
    lens = dataset.lens_of(image)
    return {
        "index": image.index,
        "split": image.split,
        "camera": frame.camera,
        "width": frame.width,
        "height": frame.height,
        "time": frame.time,
        "rolling": frame.rolling,
        "projection": lens.projection,
        "distortion": [float(k) for k in lens.distortion],
        "K": frame.K.tolist(),
        "camera_from_world_cv": frame.camera_from_world_cv.tolist(),
    }


def instances_of(image: Image, flat: bool = False) -> list[dict[str, Any]]:
    """A row per instance: every column but masks and keypoints; `category` is the class's name,
    `category_id` its id, 0 for none; `attributes` a mapping. flat: matrices are one list, row by
    row."""
    labels, categories = image.frame.labels, image.frame.categories
    rows = _rows(labels, [name for name in labels if is_of_instances(name)], flat)
    for row in rows:
        row["category_id"] = row.pop("category")
        row["category"] = categories.get(row["category_id"], "")
        row["attributes"] = json.loads(row["attributes"] or "{}")
    return rows


def keypoints_of(image: Image, flat: bool = False) -> list[dict[str, Any]]:
    """A row a keypoint: `label` is the instance's, then `name`, `position_camera` and so on."""
    labels = image.frame.labels
    rows = _rows(labels, [name for name in labels if name.startswith(_KEYPOINT)], flat)
    cut = [{name[len(_KEYPOINT) :]: value for name, value in row.items()} for row in rows]
    return [{"label": row.pop("instance"), **row} for row in cut]


def is_of_instances(name: str) -> bool:
    """True if a label column has one row per instance, and is no mask."""
    return name != _MASKS and not name.startswith(_KEYPOINT)


def _rows(labels: Mapping[str, Any], names: list[str], flat: bool) -> list[dict[str, Any]]:
    """Columns as rows; values that are not finite are None."""
    columns = [_plain(labels[name], flat) for name in names]
    return [dict(zip(names, row)) for row in zip(*columns)]


def _plain(column: Any, flat: bool) -> list[Any]:
    if isinstance(column, list):
        return column
    if flat and column.ndim > 2:
        column = column.reshape(len(column), math.prod(column.shape[1:]))
    values: list[Any] = column.tolist()
    if column.dtype.kind == "f" and not np.isfinite(column).all():
        values = [_finite(value) for value in values]
    return values


def _finite(value: Any) -> Any:
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return value if math.isfinite(value) else None
