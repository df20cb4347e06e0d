"""Ndds: JSON files of poses and cuboids that DOPE trains on. docs/datasets.md, "Ndds"."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...render.frame import Frame
from ..writer import Dataset, Image, Picture, Writer
from .drawn import check_pinhole
from .instances import Instance, check_categories, instances, quaternion_wxyz
from .shapes import shapes_of
from .symmetries import Symmetries, symmetries_of

# DOPE's order in our numbers, where 1 is the upper x (front), 2 the upper y (left), 4 the upper z:
# front left bottom, front right bottom, front right top, front left top; the same at the rear.
CUBOID = (3, 1, 5, 7, 2, 0, 4, 6)
_FRAMES = {
    "camera": "OpenCV: x right, y down, z forward; metres",
    "model": "x forward, y left, z up, from the centre of the cuboid; metres",
    "world": "z up; metres",
    "image": "pixels, x right, y down, (0, 0) is the centre of the upper left pixel",
    "matrices": "lists of rows, for column vectors",
}


class Ndds(Writer):
    """NDDS as DOPE (Tremblay et al. 2018) reads it: 000123.png with 000123.json, which has pose,
    cuboid and visibility of every instance with a category.

    categories: only these. Corners are in DOPE's order with the centroid as the ninth; an object's
    frame is x forward, y left, z up, its origin the centre of the cuboid. Instances whose cuboid is
    not wholly before the camera, or not near the image, are left out. resolve_symmetries: picks,
    for a mesh with symmetries, the one of its equivalent poses that faces the camera, upright: else
    equal pictures would have unequal labels. Refuses lenses with distortion, and instances that are
    sheared or mirrored.
    """

    picture: Picture
    labels = ("boxes", "amodal")

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        categories: Sequence[str] | None = None,
        resolve_symmetries: bool = True,
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = self.picture.planes
        self.resolve_symmetries = resolve_symmetries
        self.categories = None if categories is None else list(categories)

    def begin(self, dataset: Dataset) -> None:
        check_categories(dict(dataset.categories), self.categories)
        super().begin(dataset)
        self._symmetries: dict[int, Symmetries] = {}
        if self.resolve_symmetries:
            scene = dataset.scene
            for instance, shape in shapes_of(scene, dataset.cameras[0], self.categories):
                self._symmetries[instance.label] = symmetries_of(scene, instance, shape)

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        check_pinhole(self.dataset, image, "NDDS")
        self.put_picture(image, below="")
        found = [i for i in instances(frame, self.categories) if i.number("canvas")]
        seen = [i for i in found if np.isfinite(i.labels["corners_image"][i.row]).all()]
        content = {
            "camera_data": camera_data(frame),
            "objects": [object_data(i, frame.K, self._symmetries.get(i.label)) for i in seen],
            "frames": _FRAMES,
        }
        name = "/".join(part for part in (image.split, f"{image.name}.json") if part)
        self.put(name, json.dumps(content, indent=2, allow_nan=False) + "\n")
        return {"objects": len(seen)}


def camera_data(frame: Frame) -> dict[str, Any]:
    k = frame.K
    world_from_camera = np.linalg.inv(frame.camera_from_world_cv)
    return {
        "width": frame.width,
        "height": frame.height,
        "camera_view_matrix": frame.camera_from_world_cv.tolist(),
        "location_world": world_from_camera[:3, 3].tolist(),
        "quaternion_world_xyzw": _xyzw(world_from_camera),
        "intrinsics": {name: k[at] for name, at in _INTRINSICS.items()},
    }


_INTRINSICS = {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}


def object_data(
    instance: Instance, K: NdArray, symmetries: Symmetries | None = None
) -> dict[str, Any]:
    """An entry of "objects", in the pose that faces the camera. K: (3, 3)."""
    pose, world_pose = instance.camera_from_object, instance.world_from_object
    if symmetries:
        same = symmetries.facing(pose)
        pose, world_pose = pose @ same, world_pose @ same
    center = np.eye(4)
    center[:3, 3] = instance.labels["box_center"][instance.row]
    pose, world_pose = pose @ center, world_pose @ center
    local = instance.corners[list(CUBOID)] - center[:3, 3]
    local = np.concatenate([local, np.zeros((1, 3))])
    in_camera = local @ pose[:3, :3].T + pose[:3, 3]
    in_image = in_camera @ K.T
    return {
        "class": instance.category,
        "name": instance.name,
        "visibility": instance.number("visibility"),
        "location": pose[:3, 3].tolist(),
        "quaternion_xyzw": _xyzw(pose),
        "local_to_world_matrix": world_pose.tolist(),
        "local_cuboid": local.tolist(),
        "projected_cuboid": (in_image[:, :2] / in_image[:, 2:]).tolist(),
    }


def _xyzw(pose: NdArray) -> list[float]:
    w, x, y, z = (float(v) for v in quaternion_wxyz(pose[:3, :3]))
    return [x, y, z, w]
