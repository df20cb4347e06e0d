"""scene_gt_coco.json of BOP. Used by bop.py and bop_image.py.

Format: bop_toolkit, scripts/calc_gt_coco.py.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import INTEGER, fields_of, numbers, read_object
from .masks import counts_of, extent, mask_of
from .report import Faults, Malformed

_ANNOTATION = {"id": INTEGER, "image_id": INTEGER, "category_id": INTEGER, "bbox": numbers(4)}
_IGNORED_BELOW = 0.1


def read_coco(
    scene: Path, images: list[int], faults: Faults
) -> dict[int, list[dict[str, Any]]] | None:
    """Annotations by image in the file's order; None where there is no such file."""
    path = scene / "scene_gt_coco.json"
    if not path.is_file():
        return None
    content = read_object(path)
    rows = content.get("annotations", [])
    out: dict[int, list[dict[str, Any]]] = {image: [] for image in images}
    for row in rows:
        wrong = fields_of(row, _ANNOTATION)
        if wrong:
            raise Malformed(path, f"an annotation {wrong}")
        out.setdefault(row["image_id"], []).append(row)
    ids = Counter(row["id"] for row in rows)
    for number, times in sorted(ids.items()):
        if times > 1 or number < 1:
            why = f"is there {times} times" if times > 1 else "is below 1"
            faults.add("coco_ids", path, f"annotation id {number} {why}: count them from 1")
    listed = [image.get("id") for image in content.get("images", [])]
    if sorted(listed) != images or set(out) != set(images):
        faults.add(
            "coco_ids",
            path,
            f"has images {sorted(listed)[:9]} with annotations of {sorted(out)[:9]}: scene_gt.json "
            f"has {images[:9]}",
        )
    return out


def check_rows(
    path: Path,
    rows: list[dict[str, Any]],
    instances: list[tuple[int, float, NdArray, NdArray]],
    faults: Faults,
) -> None:
    """Annotations of one image. instances: (obj_id, visib_fract, mask, mask_visib) of the visible
    ones, in order."""
    expected = [instance[0] for instance in instances]
    if [row["category_id"] for row in rows] != expected:
        faults.add(
            "coco_instances",
            path,
            f"has categories {[row['category_id'] for row in rows]}: the visible instances of "
            f"scene_gt.json are {expected}",
        )
        return
    for row, (_, fraction, whole, seen) in zip(rows, instances):
        name = f"annotation {row['id']}"
        x0, y0, x1, y1 = extent(whole)
        if row["bbox"] != [x0, y0, x1 - x0, y1 - y0]:
            faults.add(
                "coco_bbox",
                path,
                f"{name}: bbox is {row['bbox']}: the silhouette's is {[x0, y0, x1 - x0, y1 - y0]} "
                "(here width and height count pixels)",
            )
        if not _is_mask(row, seen):
            faults.add(
                "coco_mask",
                path,
                f"{name}: segmentation and area ({row.get('area')}) differ from mask_visib, "
                f"which has {int(seen.sum())} pixels: encode it column by column",
            )
        if bool(row.get("ignore")) != (fraction < _IGNORED_BELOW):
            faults.add(
                "coco_ignore",
                path,
                f"{name}: ignore is {row.get('ignore')!r}, and visib_fract {fraction:.3g}: it is "
                "true below 0.1",
            )


def _is_mask(row: dict[str, Any], seen: NdArray) -> bool:
    segmentation = row.get("segmentation", {})
    if list(segmentation.get("size", ())) != list(seen.shape) or row.get("area") != seen.sum():
        return False
    try:
        return np.array_equal(mask_of(counts_of(segmentation), seen.shape), seen)
    except ValueError:
        return False
