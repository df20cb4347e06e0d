"""NerfTransforms: transforms.json of instant-ngp and nerfstudio. docs/datasets.md."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np

from ...errors import InvalidArgument
from ...render.frame import Frame
from ...values.components import Camera
from ..writer import Image, Picture, Records, Writer
from .drawn import camera_of

_RADIAL = ("k1", "k2", "k3", "k4")
_OWN = ("file_path", "transform_matrix")
_MODELS = {"fisheye": "OPENCV_FISHEYE", "equirectangular": "EQUIRECTANGULAR"}


class NerfTransforms(Writer):
    """transforms.json as instant-ngp and nerfstudio read it; with splits transforms_train.json and
    so on, as the synthetic scenes of NeRF have them (Mildenhall et al. 2020).

    Each frame has its own intrinsics and camera-to-world matrix, OpenGL camera (x right, y up,
    looks down -z), world z up, metres. There c_x of the upper left pixel's centre is 0.5: ours
    plus a half. Perspective cameras have k1 k2 p1 p2 k3, fisheyes k1 to k4; the rational model
    and orthographic cameras are refused.
    """

    picture: Picture

    def __init__(
        self, directory: str | os.PathLike[str], *, picture: Picture | str = "png"
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = self.picture.planes

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        world_from_camera = np.linalg.inv(frame.camera_from_world_gl)
        return {
            "file_path": self.put_picture(image),
            **lens(camera_of(self.dataset, image), frame),
            "transform_matrix": world_from_camera.tolist(),
        }

    def finish(self, records: Records) -> None:
        for split in self.dataset.splits or ("",):
            frames = [record for _, record in records.of_split(split)]
            if not frames:
                continue
            shared = {
                key: value
                for key, value in frames[0].items()
                if key not in _OWN and all(frame.get(key) == value for frame in frames)
            }
            own = [{k: v for k, v in frame.items() if k not in shared} for frame in frames]
            text = json.dumps({**shared, "frames": own}, indent=2)
            self.put(f"transforms{split and '_' + split}.json", text + "\n")


def lens(camera: Camera, frame: Frame) -> dict[str, Any]:
    """The intrinsics of a frame, in nerfstudio's words."""
    coefficients = [float(c) for c in camera.distortion]
    distortion: dict[str, float] = {}
    if camera.projection == "perspective":
        if any(coefficients[5:]):
            raise InvalidArgument(
                f"{frame.camera}: transforms.json has k1 k2 p1 p2 k3 of a perspective camera, and "
                f"it has {tuple(coefficients)}; use Colmap, or take k4 to k6 off",
                field="camera",
            )
        model = "OPENCV" if any(coefficients) else "PINHOLE"
        if any(coefficients):
            distortion = dict(zip(("k1", "k2", "p1", "p2", "k3"), coefficients))
    elif camera.projection in _MODELS:
        model = _MODELS[camera.projection]
        distortion = dict(zip(_RADIAL, coefficients))
    else:
        raise InvalidArgument(
            f"{frame.camera}: is {camera.projection}, which transforms.json has not; use a "
            "perspective camera",
            field="camera",
        )
    k = frame.K
    return {
        "camera_model": model,
        "w": frame.width,
        "h": frame.height,
        "fl_x": k[0, 0],
        "fl_y": k[1, 1],
        "cx": k[0, 2] + 0.5,
        "cy": k[1, 2] + 0.5,
        **distortion,
        **_angle(model, frame),
    }


def _angle(model: str, frame: Frame) -> dict[str, float]:
    """The synthetic scenes' loaders want the angle of view, and know no other lens."""
    if model != "PINHOLE":
        return {}
    return {"camera_angle_x": 2 * float(np.arctan(0.5 * frame.width / frame.K[0, 0]))}
