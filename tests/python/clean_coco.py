"""A clean COCO data set by pycocotools and numpy, and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from pycocotools import mask as oracle
from shapes_seen import HEIGHT, WIDTH, edit_json, edit_picture, masks, picture, write_json

INSTANCES = "annotations/instances_train.json"
PANOPTIC = "annotations/panoptic_train.json"
PANOPTIC_PNG = "annotations/panoptic_train/000001.png"


def make(root: Path) -> None:
    images = [
        {"id": i, "file_name": f"{i:06d}.png", "width": WIDTH, "height": HEIGHT} for i in range(3)
    ]
    categories = [
        {"id": 1, "name": "bolt", "supercategory": ""},
        {"id": 2, "name": "nüt", "keypoints": ["tip", "end"], "skeleton": [[1, 2]]},
    ]
    annotations, panoptic = [], []
    for image in range(3):
        picture(root / f"images/train/{image:06d}.png", image)
        if image == 2:
            continue  # nothing is seen
        ids = np.zeros((HEIGHT, WIDTH), np.int64)
        segments = []
        for i, mask in enumerate(masks(image)):
            runs = oracle.encode(np.asfortranarray(mask.astype(np.uint8)))
            box = [int(v) for v in oracle.toBbox(runs)]
            segment = 300 * (i + 1)
            ids[mask] = segment
            shared = {"category_id": i + 1, "bbox": box, "area": int(oracle.area(runs))}
            counts = {"size": [HEIGHT, WIDTH], "counts": runs["counts"].decode()}
            if i:
                flat = mask.ravel(order="F")
                edges = np.flatnonzero(np.diff(np.concatenate([[0], flat, [0]])))
                plain = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
                counts["counts"] = plain
                shared |= {"keypoints": [20.5, 14.0, 2, 0, 0, 0], "num_keypoints": 1}
            numbers = {"id": len(annotations) + 1, "image_id": image, "iscrowd": 0}
            annotations.append({**numbers, **shared, "segmentation": counts})
            keep = {k: shared[k] for k in ("category_id", "bbox", "area")}
            segments.append({"id": segment, "iscrowd": 0, **keep})
        colors = np.stack([ids % 256, ids // 256, ids // 65536], axis=2).astype(np.uint8)
        file = root / f"annotations/panoptic_train/{image:06d}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(colors).save(file)
        panoptic.append({"image_id": image, "file_name": file.name, "segments_info": segments})
    plate = {"id": 5, "image_id": 1, "category_id": 1, "iscrowd": 0, "area": 12.0}
    plate |= {"bbox": [40, 20, 4, 3], "segmentation": [[40, 20, 44, 20, 44, 23, 40, 23]]}
    content = {"info": {}, "images": images, "categories": categories}
    write_json(root / INSTANCES, {**content, "annotations": [*annotations, plate]})
    kinds = [{**c, "isthing": 1} for c in categories]
    write_json(root / PANOPTIC, {"images": images, "annotations": panoptic, "categories": kinds})


def annotation(number: int, **changes):
    """A fault: other values of an annotation."""

    def plant(root: Path) -> None:
        def change(content) -> None:
            row = next(a for a in content["annotations"] if a["id"] == number)
            for key, value in changes.items():
                row[key] = value(row[key]) if callable(value) else value

        edit_json(root / INSTANCES, change)

    return plant


def content(change, file: str = INSTANCES):
    """A fault: something else in a file."""
    return lambda root: edit_json(root / file, change)


def segment(**changes):
    return content(
        lambda c: c["annotations"][1]["segments_info"][0].update(changes) or None, PANOPTIC
    )


def by_rows(segmentation):
    mask = masks(0)[0]
    flat = mask.ravel(order="C")
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat, [0]])))
    counts = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return {**segmentation, "counts": counts}


def all_of_first(segmentation):
    both = np.asfortranarray((masks(0)[0] | masks(0)[1]).astype(np.uint8))
    return {**segmentation, "counts": oracle.encode(both)["counts"].decode()}


def overlapping(root: Path) -> None:
    both = masks(0)[0] | masks(0)[1]
    x0, x1 = np.flatnonzero(both.any(0))[[0, -1]]
    y0, y1 = np.flatnonzero(both.any(1))[[0, -1]]
    box = [int(x0), int(y0), int(x1 - x0 + 1), int(y1 - y0 + 1)]
    annotation(2, segmentation=all_of_first, bbox=box, area=int(both.sum()))(root)


FAULTS = {
    "annotation id twice": ("coco.ids", annotation(2, id=1)),
    "annotation id 0": ("coco.ids", annotation(1, id=0)),
    "image id twice": ("coco.ids", content(lambda c: c["images"][2].update(id=1))),
    "category id 0": (
        "coco.ids",
        content(lambda c: c["categories"].append({"id": 0, "name": "background"})),
    ),
    "image of nothing": ("coco.references", annotation(1, image_id=77)),
    "category of nothing": ("coco.references", annotation(1, category_id=9)),
    "skeleton from 0": (
        "coco.references",
        content(lambda c: c["categories"][1].update(skeleton=[[0, 1]])),
    ),
    "picture removed": (
        "coco.image_files",
        lambda root: (root / "images/train/000002.png").unlink(),
    ),
    "width and height swapped": (
        "coco.image_files",
        lambda root: picture(root / "images/train/000002.png", 2, (HEIGHT, WIDTH)),
    ),
    "picture without entry": (
        "coco.counts",
        lambda root: picture(root / "images/train/000003.png", 3),
    ),
    "box without +1": ("coco.bbox", annotation(1, bbox=lambda b: [*b[:2], b[2] - 1, b[3] - 1])),
    "box as corners": (
        "coco.bbox",
        annotation(1, bbox=lambda b: [b[0], b[1], b[0] + b[2], b[1] + b[3]]),
    ),
    "box moved by one": ("coco.bbox", annotation(2, bbox=lambda b: [b[0] + 1, *b[1:]])),
    "negative width": ("coco.bbox", annotation(2, bbox=lambda b: [*b[:2], -b[2], b[3]])),
    "polygon's box": ("coco.bbox", annotation(5, bbox=[40, 20, 7, 3])),
    "area of the box": ("coco.area", annotation(1, area=lambda a: a + 31)),
    "polygon's area": ("coco.area", annotation(5, area=60)),
    "run lengths by rows": ("coco.rle_order", annotation(1, segmentation=by_rows)),
    "run lengths too short": (
        "coco.segmentation",
        annotation(2, segmentation=lambda s: {**s, "counts": s["counts"][:-1]}),
    ),
    "size as width, height": (
        "coco.segmentation",
        annotation(1, segmentation=lambda s: {**s, "size": s["size"][::-1]}),
    ),
    "empty mask": (
        "coco.segmentation",
        annotation(1, segmentation=lambda s: {**s, "counts": [WIDTH * HEIGHT]}),
    ),
    "polygon outside": (
        "coco.segmentation",
        annotation(5, segmentation=[[40, 20, 60, 20, 60, 23, 40, 23]]),
    ),
    "masks overlap": ("coco.disjoint", overlapping),
    "v is 3": ("coco.keypoints", annotation(2, keypoints=[20.5, 14, 3, 0, 0, 0])),
    "v is 0 but placed": ("coco.keypoints", annotation(2, keypoints=[20.5, 14, 2, 3, 4, 0])),
    "keypoint outside": (
        "coco.keypoints",
        annotation(2, keypoints=[99, 14, 2, 0, 0, 0]),
    ),
    "keypoints of another class": ("coco.keypoints", annotation(2, keypoints=[20.5, 14, 2])),
    "num_keypoints": ("coco.keypoints", annotation(2, num_keypoints=2)),
    "not JSON": ("coco.format", lambda root: (root / INSTANCES).write_text('{"images": [')),
    "annotation without id": (
        "coco.format",
        content(lambda c: c["annotations"][0].pop("id") and None),
    ),
    "segment not listed": (
        "coco.panoptic_ids",
        content(lambda c: c["annotations"][1]["segments_info"].pop() and None, PANOPTIC),
    ),
    "segment id in BGR": (
        "coco.panoptic_ids",
        lambda root: edit_picture(root / PANOPTIC_PNG, lambda p: p[..., ::-1].copy()),
    ),
    "segment's area": ("coco.panoptic_area", segment(area=7)),
    "segment's box": ("coco.panoptic_bbox", segment(bbox=[0, 0, 5, 5])),
}
