"""Kitti: KITTI's object and scene flow benchmarks. docs/datasets.md, "Kitti"."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import InvalidArgument
from ...scene.handles import Handle, Named
from ..writer import Dataset, Image, Picture, Records, Writer
from .drawn import check_pinhole, drawn
from .encoded import kitti_disparity, kitti_flow
from .instances import Instance, check_categories, instances, wrapped
from .later import second_picture
from .shapes import crowds_in, crowds_of

_PARTLY, _LARGELY = 0.05, 0.5  # from which occlusion on an object is partly, largely occluded
_NO_POSE, _NO_PLACE = "-1 -1 -10", "-1 -1 -1 -1000 -1000 -1000 -10"  # before and after the box
_FLOW = ("flow_forward", "flow_forward_valid", "flow_forward_visible")
_CAMERA_FROM_VELODYNE = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]])


@dataclass(frozen=True)
class Limits:
    """Limits beyond which a labeller would leave an object alone. min_height: rows of the box;
    max_occlusion and max_truncation: shares of the silhouette, 0 to 1."""

    min_height: float = 10.0
    max_occlusion: float = 0.9
    max_truncation: float = 0.9

    def __post_init__(self) -> None:
        for name in ("max_occlusion", "max_truncation"):
            if not 0 <= getattr(self, name) <= 1:
                raise InvalidArgument(f"{name}: is a share, 0 to 1", field=name)

    def refuse(self, instance: Instance) -> bool:
        """Is it beyond them?"""
        _, top, _, bottom = instance.box("bbox_amodal")
        return (
            bottom - top < self.min_height
            or instance.number("occlusion") > self.max_occlusion
            or instance.number("truncation") > self.max_truncation
        )


class Kitti(Writer):
    """KITTI (Geiger, Lenz & Urtasun 2012; Menze & Geiger 2015): training/image_2, label_2, calib,
    and on demand flow_occ, flow_noc, disp_occ_0, disp_noc_0.

    objects: write label_2 of the instances that have a category and are seen, of `categories` only.
    flow: the forward flow, and the second picture (000123_11.png); give generate() a
    frame_interval. disparity: the second camera of a rectified rig, hg.stereo's right one.
    min_height, max_occlusion, max_truncation: Limits, beyond which an object is a DontCare region;
    so are crowds, instances with group=True.
    An object's x axis is forward, z up, as in KITTI's cars length, width and height are along x, y
    and z. Refuses lenses with distortion, and instances that are sheared or mirrored.
    """

    picture: Picture
    planes: tuple[str, ...] = ()
    labels: Any = False

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        objects: bool = True,
        categories: Sequence[str] | None = None,
        flow: bool = False,
        disparity: Named | None = None,
        min_height: float = Limits.min_height,
        max_occlusion: float = Limits.max_occlusion,
        max_truncation: float = Limits.max_truncation,
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        if self.picture.format != "png":
            raise InvalidArgument("picture: KITTI's are PNG files", field="picture")
        if not (objects or flow or disparity):
            raise InvalidArgument("objects: nothing is asked for", field="objects")
        self.objects, self.flow = objects, flow
        self.disparity = disparity.name if isinstance(disparity, Handle) else disparity
        self.categories = None if categories is None else list(categories)
        self.limits = Limits(min_height, max_occlusion, max_truncation)
        self.planes = self.picture.planes
        if flow:
            self.planes += _FLOW
        if self.disparity:
            self.planes += (f"disparity:{self.disparity}", f"disparity_visible:{self.disparity}")
        self.labels = ("boxes", "amodal") if objects else False

    def begin(self, dataset: Dataset) -> None:
        if self.objects:
            check_categories(dict(dataset.categories), self.categories)
            names = self.categories or list(dataset.categories.values())
            spaced = [name for name in names if len(name.split()) != 1]
            if spaced:
                raise InvalidArgument(
                    f"categories: {spaced[0]!r}: a type of KITTI is one word; rename the category",
                    field="categories",
                )
            self._crowds = crowds_of(dataset.scene)
        super().begin(dataset)

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        check_pinhole(self.dataset, image, "KITTI")
        picture = self.picture.encode(frame)
        lines: list[str] = []
        if self.objects:
            lines = self._lines(image)
            self._put("label_2", f"{image.name}.txt", "".join(lines))
            self._put("image_2", f"{image.name}.png", picture)
        self._put("calib", f"{image.name}.txt", calibration(frame.K, self._baseline(image)))
        first = f"{image.name}_10.png"
        if self.flow or self.disparity:
            self._put("image_2", first, picture)
        if self.flow:
            flow, valid, seen = (frame[name] for name in _FLOW)
            self._put("flow_occ", first, kitti_flow(flow, valid))
            self._put("flow_noc", first, kitti_flow(flow, valid & seen))
            second = second_picture(self.dataset.scene, image, self.picture)
            self._put("image_2", f"{image.name}_11.png", second)
        if self.disparity:
            shift, seen = frame["disparity"], frame["disparity_visible"]
            self._put("disp_occ_0", first, kitti_disparity(shift, np.ones_like(seen)))
            self._put("disp_noc_0", first, kitti_disparity(shift, seen))
        return {"labels": len(lines)}

    def _lines(self, image: Image) -> list[str]:
        """Lines of a file of label_2."""
        crowds = crowds_in(image, self._crowds)
        seen = [i for i in instances(image.frame, self.categories) if i.number("visible")]
        return [
            region_line(i) if i.label in crowds or self.limits.refuse(i) else label_line(i)
            for i in seen
        ]

    def _put(self, folder: str, name: str, data: bytes | str) -> None:
        self.put(f"training/{folder}/{name}", data)

    def _baseline(self, image: Image) -> float:
        """Metres from this camera to the second one."""
        if not self.disparity:
            return 0.0
        with drawn(self.dataset.scene, image) as scene:
            rig = scene.handle(self.dataset.camera_of(image.index).id), scene[self.disparity]
            places = [camera.world_transform for camera in rig]
        return float(np.linalg.norm(places[1][:3, 3] - places[0][:3, 3]))

    def finish(self, records: Records) -> None:
        for split in self.dataset.splits or ("train",):
            chosen = records.of_split(split) if self.dataset.splits else records
            self._put_list(split, chosen)
        self._put_list("trainval", records)

    def _put_list(self, name: str, records: Records) -> None:
        self.put(f"ImageSets/{name}.txt", "".join(f"{index:06d}\n" for index, _ in records))


def label_line(instance: Instance) -> str:
    """A line of label_2 (devkit_object/readme.txt): type, truncated, occluded, alpha, box, height
    width length, the place of the box's bottom face, rotation_y; pixels, metres, radians.

    KITTI turns boxes about the camera's y axis alone: the box is the smallest one of the object's
    heading that contains the object's own, which it is where the object stands upright before a
    level camera.
    """
    turn = instance.camera_from_object[:3, :3]
    rotation_y = math.atan2(-turn[2, 0], turn[0, 0])
    c, s = math.cos(rotation_y), math.sin(rotation_y)
    camera_from_box = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # x forward, y down
    corners = instance.corners @ turn.T + instance.camera_from_object[:3, 3]
    upright = corners @ camera_from_box
    low, high = upright.min(0), upright.max(0)
    length, height, width = high - low
    bottom = camera_from_box @ [(low[0] + high[0]) / 2, high[1], (low[2] + high[2]) / 2]
    alpha = wrapped(rotation_y - math.atan2(bottom[0], bottom[2]))
    left, top, right, below = instance.box("bbox_amodal")
    occlusion = instance.number("occlusion")
    occluded = int(occlusion >= _PARTLY) + int(occlusion >= _LARGELY)
    numbers = [alpha, left, top, right - 1, below - 1, height, width, length, *bottom, rotation_y]
    text = " ".join(f"{number:.6g}" for number in numbers)
    return f"{instance.category} {instance.number('truncation'):.4f} {occluded} {text}\n"


def region_line(instance: Instance) -> str:
    """Line of a DontCare region, neither trained on nor held against a detector: its box alone."""
    left, top, right, below = instance.box("bbox_amodal")
    return f"DontCare {_NO_POSE} {left} {top} {right - 1} {below - 1} {_NO_PLACE}\n"


def calibration(K: NdArray, baseline: float = 0.0) -> str:
    """A file of calib: the left cameras 0 and 2 are this one, the right ones 1 and 3 the second
    one, `baseline` metres to the right. There is no laser: its frame is the camera's, turned."""
    left, right = np.zeros((3, 4)), np.zeros((3, 4))
    left[:, :3] = right[:, :3] = K
    right[0, 3] = -K[0, 0] * baseline
    rows = [(f"P{i}", (left, right)[i % 2]) for i in range(4)]
    rows.append(("R0_rect", np.eye(3)))
    rows.append(("Tr_velo_to_cam", _CAMERA_FROM_VELODYNE))
    rows.append(("Tr_imu_to_velo", np.eye(4)[:3]))
    return "".join(f"{n}: " + " ".join(f"{v:.12e}" for v in m.ravel()) + "\n" for n, m in rows)
