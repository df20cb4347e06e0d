"""Checks of one image of BOP: camera, poses, masks, depth. Used by bop.py."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .bop_coco import check_rows
from .bop_models import Model
from .files import picture_size, read_picture
from .geometry import project, rotation_fault
from .masks import extent
from .report import Faults

_HIDDEN = [-1, -1, -1, -1]


@dataclass
class Picture:
    """Image of a scene as its JSON files describe it."""

    number: int
    camera: dict[str, Any]
    gt: list[dict[str, Any]]
    info: list[dict[str, Any]]
    coco: list[dict[str, Any]] | None


@dataclass
class _Instance:
    """An entry of scene_gt with its masks. name: for messages."""

    name: str
    number: int
    gt: dict[str, Any]
    info: dict[str, Any]
    whole: NdArray
    seen: NdArray


def check_pictures(
    scene: Path,
    pictures: list[Picture],
    models: dict[int, Model],
    exact: bool,
    faults: Faults,
) -> None:
    """Some images of a scene. exact: visible masks may not overlap."""
    for picture in pictures:
        _Image(scene, picture, models, faults).check(exact)


class _Image:
    def __init__(
        self, scene: Path, picture: Picture, models: dict[int, Model], faults: Faults
    ) -> None:
        self.scene, self.picture, self.models, self.faults = scene, picture, models, faults

    def check(self, exact: bool) -> None:
        size = self._size()
        if size is None:
            return
        if not self._is_camera(size):
            return
        depth = self._depth(size)
        instances = [found for i in range(len(self.picture.gt)) if (found := self._read(i, size))]
        owner = np.zeros(size[::-1], np.int64)
        for instance in instances:
            self._masks(instance)
            if exact and owner[instance.seen].any():
                self._fault(
                    "mask_disjoint",
                    instance,
                    f"shares pixels with instance {owner[instance.seen].max() - 1}: a pixel "
                    "belongs to the nearest one only",
                )
            owner[instance.seen] = instance.number + 1
            self._info(instance, depth)
            self._pose(instance, depth)
        if self.picture.coco is not None and len(instances) == len(self.picture.gt):
            seen = [i for i in instances if i.seen.any()]
            rows = [(i.gt["obj_id"], i.info["visib_fract"], i.whole, i.seen) for i in seen]
            check_rows(self.scene / "scene_gt_coco.json", self.picture.coco, rows, self.faults)

    def _fault(self, check: str, instance: _Instance, message: str) -> None:
        file = "scene_gt_info.json" if check in instance.info or "_" in check else "scene_gt.json"
        self.faults.add(check, self.scene / file, f"{instance.name}: {message}")

    # ------------------------------------------------------------ files

    def _size(self) -> tuple[int, int] | None:
        """(width, height) of the picture's file; None, and a fault, where there is none."""
        names = [
            self.scene / folder / f"{self.picture.number:06d}.{ending}"
            for folder in ("rgb", "gray")
            for ending in ("png", "jpg", "tif")
        ]
        there = next((path for path in names if path.is_file()), None)
        if there is None:
            self.faults.add(
                "image_files", names[0], "is not there, and scene_gt.json has the image: write it"
            )
            return None
        return picture_size(there)

    def _grey(self, path: Path, size: tuple[int, int]) -> NdArray | None:
        if not path.is_file():
            self.faults.add("image_files", path, "is not there: write it")
            return None
        pixels = read_picture(path)
        if pixels.shape[1::-1] != size:
            self.faults.add(
                "image_files",
                path,
                f"is {pixels.shape[1]}x{pixels.shape[0]}, the picture {size[0]}x{size[1]}",
            )
            return None
        return pixels

    def _depth(self, size: tuple[int, int]) -> NdArray | None:
        """(H, W) mm, 0 where none is known."""
        path = self.scene / "depth" / f"{self.picture.number:06d}.png"
        pixels = self._grey(path, size)
        if pixels is None:
            return None
        if pixels.ndim != 2 or pixels.dtype != np.uint16:
            self.faults.add("depth", path, "is no 16-bit grey PNG: depth is, in depth_scale mm")
            return None
        return np.asarray(pixels * float(self.picture.camera["depth_scale"]))

    def _read(self, i: int, size: tuple[int, int]) -> _Instance | None:
        masks = []
        for folder in ("mask", "mask_visib"):
            path = self.scene / folder / f"{self.picture.number:06d}_{i:06d}.png"
            pixels = self._grey(path, size)
            if pixels is None:
                return None
            if pixels.ndim != 2 or pixels.dtype != np.uint8 or not np.isin(pixels, (0, 255)).all():
                self.faults.add("masks", path, "is no 8-bit grey PNG of 0 and 255: masks are")
                return None
            masks.append(pixels > 0)
        name = f"image {self.picture.number}, instance {i}"
        return _Instance(name, i, self.picture.gt[i], self.picture.info[i], masks[0], masks[1])

    # ------------------------------------------------------------ camera, masks, info

    def _is_camera(self, size: tuple[int, int]) -> bool:
        """Can it be reckoned with?"""
        path = self.scene / "scene_camera.json"
        camera = self.picture.camera
        K = np.reshape(camera["cam_K"], (3, 3))
        before = self.faults.counts["bop.camera"]
        if K[0, 0] <= 0 or K[1, 1] <= 0 or list(K[2]) != [0, 0, 1] or K[1, 0]:
            self.faults.add(
                "camera",
                path,
                f"image {self.picture.number}: cam_K is {K.tolist()}: needs fx, 0, cx, 0, fy, cy, "
                "0, 0, 1 by rows",
            )
        elif not (-size[0] <= K[0, 2] <= 2 * size[0] and -size[1] <= K[1, 2] <= 2 * size[1]):
            self.faults.add(
                "camera",
                path,
                f"image {self.picture.number}: the principal point {K[:2, 2].tolist()} is far "
                f"outside the picture {size[0]}x{size[1]}: write cam_K of this size",
            )
        if camera["depth_scale"] <= 0:
            self.faults.add("camera", path, f"depth_scale is {camera['depth_scale']}: needs > 0")
        if "cam_R_w2c" in camera:
            wrong = rotation_fault(np.reshape(camera["cam_R_w2c"], (3, 3)))
            if wrong:
                self.faults.add("poses", path, f"image {self.picture.number}: cam_R_w2c {wrong}")
        return self.faults.counts["bop.camera"] == before

    def _masks(self, instance: _Instance) -> None:
        beyond = int((instance.seen & ~instance.whole).sum())
        if beyond:
            self._fault(
                "mask_subset", instance, f"mask_visib has {beyond} pixels that mask has not"
            )

    def _info(self, instance: _Instance, depth: NdArray | None) -> None:
        info, whole, seen = instance.info, instance.whole, instance.seen
        expected = {"px_count_visib": int(seen.sum())}
        if depth is not None:
            expected["px_count_valid"] = int((depth[whole] > 0).sum())
        for key, value in expected.items():
            if info[key] != value:
                self._fault("px_count", instance, f"{key} is {info[key]}: counted are {value}")
        if info["px_count_all"] < whole.sum():
            self._fault(
                "px_count",
                instance,
                f"px_count_all is {info['px_count_all']}, and the part in the image has "
                f"{int(whole.sum())}: it counts the part outside, too",
            )
        every = info["px_count_all"]
        share = float(seen.sum()) / every if every else 0.0
        if abs(info["visib_fract"] - share) > 1e-4:
            self._fault(
                "visib_fract",
                instance,
                f"visib_fract is {info['visib_fract']:g}: needs px_count_visib / px_count_all, "
                f"{share:g}",
            )
        expected_box = _box(seen) if seen.any() else _HIDDEN
        if info["bbox_visib"] != expected_box:
            self._fault(
                "bbox_visib",
                instance,
                f"bbox_visib is {info['bbox_visib']}: needs {expected_box} (width and height are "
                "last - first; -1 for a hidden instance)",
            )
        self._box_of_all(instance)

    def _box_of_all(self, instance: _Instance) -> None:
        info, whole = instance.info, instance.whole
        x, y, w, h = given = info["bbox_obj"]
        if not instance.seen.any():
            if given != _HIDDEN:
                self._fault(
                    "bbox_obj",
                    instance,
                    f"bbox_obj is {given}: a hidden instance has {_HIDDEN}",
                )
            return
        inner = _box(whole)
        contains = x <= inner[0] and y <= inner[1]
        contains &= x + w >= inner[0] + inner[2] and y + h >= inner[1] + inner[3]
        if given != inner and (not contains or info["px_count_all"] == whole.sum()):
            self._fault(
                "bbox_obj",
                instance,
                f"bbox_obj is {given}: the mask's is {inner} (width and height are last - first)",
            )

    # ------------------------------------------------------------ poses

    def _pose(self, instance: _Instance, depth: NdArray | None) -> None:
        rotation = np.reshape(np.array(instance.gt["cam_R_m2c"], float), (3, 3))
        t = np.array(instance.gt["cam_t_m2c"], float)
        wrong = rotation_fault(rotation)
        if wrong:
            self._fault("poses", instance, f"cam_R_m2c {wrong}")
            return
        model = self.models.get(instance.gt["obj_id"])
        if model is None:
            self._fault(
                "objects",
                instance,
                f"obj_id {instance.gt['obj_id']} has no model in models_info.json: add it",
            )
            return
        if t[2] <= 0 and instance.seen.any():
            if (model.points @ rotation[2] + t[2]).max() <= 0:
                self._fault(
                    "behind",
                    instance,
                    f"t_z is {t[2]:g}, no point of the model is before the camera, and it is seen: "
                    "the camera looks along +z (OpenCV)",
                )
            return
        far = self._far(instance, depth, float(t[2]), model.radius)
        if not far:
            self._reprojection(instance, model, rotation, t)

    def _far(self, instance: _Instance, depth: NdArray | None, z: float, radius: float) -> bool:
        """Is the depth where it is seen not the object's?"""
        if depth is None or not (depth[instance.seen] > 0).any():
            return False
        values = depth[instance.seen]
        middle = float(np.median(values[values > 0]))
        ratio = middle / z
        scale = float(self.picture.camera["depth_scale"])
        if not 1 / 30 < ratio < 30:
            self._fault(
                "units",
                instance,
                f"t_z is {z:g} mm, and its depth {middle:g} mm: cam_t_m2c is in mm, depth PNGs in "
                "depth_scale mm",
            )
            return True
        if abs(middle - z) > radius + 2 * scale + 15:
            self._fault(
                "depth",
                instance,
                f"t_z is {z:g} mm, its depth {middle:g} mm, and the model reaches {radius:g} mm "
                "from its origin: depth is along the optical axis, times depth_scale",
            )
            return True
        return False

    def _reprojection(
        self, instance: _Instance, model: Model, rotation: NdArray, t: NdArray
    ) -> None:
        points = model.points @ rotation.T + t
        if not instance.seen.any() or (points[:, 2] <= 0).any():
            return
        K = np.reshape(self.picture.camera["cam_K"], (3, 3))
        pixels = project(K, points)
        low, high = pixels.min(0), pixels.max(0)
        inside = instance.info["px_count_all"] == instance.whole.sum()
        box = np.array(_box(instance.whole) if inside else instance.info["bbox_obj"], float)
        first, last = box[:2], box[:2] + box[2:]
        ratio = float(np.linalg.norm(high - low)) / max(1.0, float(np.linalg.norm(box[2:])))
        if max(ratio, 1 / max(ratio, 1e-9)) > 30 and box[2:].max() > 0:
            self._fault(
                "units",
                instance,
                f"the model's projection is {ratio:.3g} times as large as its mask: models and "
                "translations are in mm",
            )
            return
        size = np.array(instance.whole.shape[::-1])
        loose = 2 + 0.1 * (high - low).max()  # a sharp tip has no pixel of its own
        if inside:
            rows, columns = np.nonzero(instance.whole)
            reach = _reach(np.stack([columns, rows], axis=1)) - _reach(pixels)
        else:
            reach = np.concatenate([low - first, last - high])
            if (low < -size).any() or (high > 2 * size).any():
                reach = reach.clip(0)  # the canvas ends before the object
        if reach.max() > 1 or reach.min() < -loose:
            span, seen = (np.round([*a, *b], 1).tolist() for a, b in ((low, high), (first, last)))
            self._fault(
                "reprojection",
                instance,
                f"K (R p + t) spans {span}, its mask {seen}, and they are up to "
                f"{max(reach.max(), -reach.min()):.1f} px apart: R is model to camera by rows, t "
                "in mm, the camera OpenCV's",
            )


def _reach(points: NdArray) -> NdArray:
    """(32,) how far (N, 2) points go in directions all around."""
    angles = np.arange(32) * (2 * np.pi / 32)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray((points @ directions).max(0))


def _box(mask: NdArray) -> list[int]:
    """Box of a mask by scene_gt_info: x, y, width, height, where the last two are last - first."""
    x0, y0, x1, y1 = extent(mask)
    return [x0, y0, max(0, x1 - x0 - 1), max(0, y1 - y0 - 1)]
