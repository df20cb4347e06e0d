"""EXR: planes of an image as they are, in one file. Needs the package OpenEXR."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any

from ...image import exr
from ..writer import Dataset, Image, Picture, Writer
from . import rows

PLANES = (
    *("beauty", "depth", "distance", "position", "position_camera", "normal", "normal_camera"),
    *("geometric_normal", "tangent", "uv", "barycentric", "base_color", "roughness", "metallic"),
    *("transmission", "opacity", "emission", "instance", "semantic", "part", "material"),
    *("primitive", "object_coordinates", "nocs", "coverage", "albedo_mean", "variance"),
)


class Exr(Writer):
    """DIR/exr/000123.exr and DIR/labels/000123.json; with splits exr/train/ and labels/train/.

    planes: by default PLANES, which every scene has; ask for others ("flow_forward",
    "disparity:right", "beauty:GROUP", parts of the light, sensors) by name. The EXR has one part
    per plane, linear, with its unit; the first part's header has the manifest. The JSON has the
    size, time, K and pose of the camera, `instances` with every label column but masks, and
    `keypoints`; values that are not finite are null.
    picture: "png" or a Picture for images/000123.png beside it.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        planes: Sequence[str] = PLANES,
        labels: Any = True,
        picture: Picture | str | None = None,
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = tuple(dict.fromkeys((*planes, *self.picture_planes)))
        self.labels = labels

    def write(self, image: Image) -> Any:
        name = f"{image.split}/{image.name}" if image.split else image.name
        with self.file(f"exr/{name}.exr") as path:
            exr.write(path, image.frame)
        labels = labels_of(self.dataset, image)
        self.put(f"labels/{name}.json", json.dumps(labels, allow_nan=False) + "\n")
        if self.picture is not None:
            self.put_picture(image)
        return {"file": f"exr/{name}.exr"}


def labels_of(dataset: Dataset, image: Image) -> dict[str, Any]:
    """Labels of an image: camera, instances, and keypoints where there are some."""
    out = {**rows.picture_of(dataset, image), "instances": rows.instances_of(image)}
    if "keypoint_name" in image.frame.labels:
        out["keypoints"] = rows.keypoints_of(image)
    return out
