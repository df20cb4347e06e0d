"""BOP: scenes with poses, masks and depth. Images are in bop_image.py, models in bop_models.py.

Format: bop_toolkit, docs/bop_datasets_format.md, scripts/calc_gt_info.py.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from .bop_coco import read_coco
from .bop_image import Picture, check_pictures
from .bop_models import read_models
from .files import (
    INTEGER,
    LIST,
    NUMBER,
    PICTURES,
    Kind,
    batches,
    fields_of,
    numbers,
    read_object,
    wanted_count,
)
from .formats import Format, Task
from .report import Faults

CHECKS = {
    "format": "JSON files have their fields, keys are image ids without padding, masks and depth "
    "can be read",
    "images": "scene_camera, scene_gt and scene_gt_info have the same images, and as many entries",
    "counts": "as many pictures, depth maps and masks as images and instances",
    "image_files": "picture, depth and masks of an image are there and of one size",
    "camera": "cam_K is row-wise with positive focal lengths, depth_scale is positive",
    "poses": "rotations are orthonormal with determinant 1",
    "behind": "visible instances are before the camera (t_z > 0)",
    "objects": "obj_id names a model",
    "models": "models_info.json agrees with the PLY files: box, diameter, symmetries; the origin "
    "is the box's centre",
    "units": "translations, models and depth are in mm: depth at the mask against |t|, sizes",
    "depth": "depth is 16-bit grey, along the optical axis, and lies within the object where it "
    "is seen",
    "reprojection": "the model's vertices, projected by K (R p + t), span its mask within 1 px",
    "masks": "masks are 8-bit grey of 0 and 255",
    "mask_subset": "mask_visib is within mask",
    "mask_disjoint": "visible masks of an image share no pixel (but where dataset_info says that "
    "visibility is by the distance test)",
    "px_count": "px_count_visib and px_count_valid count pixels of the masks, px_count_all no less "
    "than the mask has",
    "visib_fract": "is px_count_visib / px_count_all, 0 if that is 0",
    "bbox_visib": "x, y, x1 - x0, y1 - y0 of the first and last pixels of mask_visib, without + 1; "
    "[-1, -1, -1, -1] if none is",
    "bbox_obj": "the same of the whole silhouette, also outside the image",
    "coco_ids": "ids of scene_gt_coco.json start at 1 and are unique, images are those of scene_gt",
    "coco_instances": "an annotation of each visible instance in scene_gt's order, its category "
    "the obj_id",
    "coco_bbox": "x, y, width, height of mask within the image, with + 1",
    "coco_mask": "segmentation is mask_visib as run lengths, area its pixels",
    "coco_ignore": "ignore is visib_fract < 0.1",
}

_POSE = {"obj_id": INTEGER, "cam_R_m2c": numbers(9), "cam_t_m2c": numbers(3)}
_CAMERA = {"cam_K": numbers(9), "depth_scale": NUMBER}
_INFO = {
    **dict.fromkeys(("px_count_all", "px_count_valid", "px_count_visib"), INTEGER),
    **dict.fromkeys(("bbox_obj", "bbox_visib"), numbers(4)),
    "visib_fract": NUMBER,
}
_OBJECT = Kind("an object", lambda v: isinstance(v, dict))
# Visibility by distance counts what is just behind as visible. A title or a table of names is no
# sign that it was used.
_DELTA = re.compile(r"^(?![#|]).*\bdelta\b", re.MULTILINE)


def found(root: Path) -> bool:
    return next(_scenes(root), None) is not None


def _scenes(root: Path) -> Iterator[Path]:
    """The folders of scenes: SPLIT/000000."""
    for split in sorted(path for path in root.iterdir() if path.is_dir()):
        for scene in sorted(path for path in split.iterdir() if path.is_dir()):
            if (scene / "scene_gt.json").is_file() or (scene / "scene_camera.json").is_file():
                yield scene


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    models = read_models(root / "models", faults)
    description = "\n".join(path.read_text() for path in sorted(root.glob("dataset_info.*")))
    exact = _DELTA.search(description) is None
    total = 0
    for scene in _scenes(root):
        pictures = list(_pictures(scene, faults))
        total += len(pictures)
        for batch in batches(pictures, 8):
            numbers_named = {gt["obj_id"] for picture in batch for gt in picture.gt}
            needed = {number: models[number] for number in numbers_named if number in models}
            yield partial(check_pictures, scene, batch, needed, exact)
    wanted = wanted_count(root)
    if wanted is not None and total != wanted:
        faults.add(
            "counts",
            root,
            f"the scenes have {total} images, and the data set has {wanted}: generate() it to the "
            "end",
        )


def _pictures(scene: Path, faults: Faults) -> Iterator[Picture]:
    """Images of a scene as its JSON files describe them."""
    names = ("scene_camera", "scene_gt", "scene_gt_info")
    tables = {name: read_object(scene / f"{name}.json") for name in names}
    kinds = {"scene_camera": _OBJECT, "scene_gt": LIST, "scene_gt_info": LIST}
    for name, table in tables.items():
        for key in table:
            if not key.isdigit() or str(int(key)) != key:
                faults.add(
                    "format",
                    scene / f"{name}.json",
                    f"key {key!r}: keys are image ids without padding",
                )
                return
    for name, table in tables.items():
        missing = sorted(set().union(*tables.values()) - set(table))
        if missing:
            faults.add(
                "images",
                scene / f"{name}.json",
                f"has no image {missing[0]}, which the others have: write an entry of each image, "
                "if need be an empty list",
            )
    keys = sorted(set(tables["scene_camera"]).intersection(*tables.values()), key=int)
    coco = read_coco(scene, [int(key) for key in keys], faults)
    for key in keys:
        wrong = next(filter(None, (fields_of(tables[n], {key: kinds[n]}) for n in names)), "")
        camera, gt, info = (tables[name][key] for name in names)
        wrong = wrong or _wrong_entries(camera, gt, info)
        if wrong:
            faults.add("format", scene, f"image {key}: {wrong}")
        elif len(gt) != len(info):
            faults.add(
                "images",
                scene / "scene_gt_info.json",
                f"image {key} has {len(info)} entries, and scene_gt has {len(gt)}: one of each",
            )
        else:
            yield Picture(int(key), camera, gt, info, None if coco is None else coco[int(key)])
    _check_counts(scene, tables, faults)


def _wrong_entries(camera: Any, gt: list[Any], info: list[Any]) -> str:
    wrong = fields_of(camera, _CAMERA)
    if wrong:
        return f"scene_camera {wrong}"
    for name, rows, kind in (("scene_gt", gt, _POSE), ("scene_gt_info", info, _INFO)):
        for i, row in enumerate(rows):
            wrong = fields_of(row, kind)
            if wrong:
                return f"{name}[{i}] {wrong}"
    return ""


def _check_counts(scene: Path, tables: dict[str, dict[str, Any]], faults: Faults) -> None:
    images = len(tables["scene_camera"])
    instances = sum(len(rows) for rows in tables["scene_gt"].values())
    wanted = {"rgb": images, "gray": images, "depth": images}
    wanted |= {"mask": instances, "mask_visib": instances}
    for name, count in wanted.items():
        if not (scene / name).is_dir():
            continue  # a missing picture is a fault of its image
        there = sum(path.suffix.lower() in PICTURES for path in (scene / name).iterdir())
        if there > count:
            faults.add(
                "counts",
                scene / name,
                f"has {there} files, and scene_gt.json needs {count}: remove those of no image",
            )


FORMAT = Format("bop", "BOP", "SPLIT/000000/scene_gt.json", CHECKS, found, tasks)
