"""Pictures of an image's draw at other times: the second picture of a flow, and videos."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..._wire._proto import render_pb2
from ..._wire.arrays import NdArray
from ...client.scene import Scene
from ...errors import InvalidArgument
from ...render import call
from ...render.frame import Frame
from ..writer import Image, Picture, encode
from .drawn import request_of


def pixels_at(scene: Scene, image: Image, picture: Picture, time: float) -> NdArray:
    """(H, W, 3) uint8: the same draw, camera, seed and exposure at another time, seconds."""
    request = request_of(scene, image)
    request.time = time
    for field in ("labels", "planes", "label_time", "frame_interval"):
        request.ClearField(field)
    for name in picture.planes:
        request.planes.add(plane=render_pb2.Plane.Value(f"PLANE_{name.upper()}"))
    options: Any = {"progress": False, "overlay": image.overlay}
    frame: Frame = call.run(scene, request, options)[0]
    return replace(picture, exposure=image.frame.stops(picture.exposure)).pixels(frame)


def second_picture(scene: Scene, image: Image, picture: Picture) -> bytes:
    """The file of the picture that forward flow goes to."""
    interval = request_of(scene, image).frame_interval
    if not interval:
        raise InvalidArgument(
            "frame_interval: not given, so that there is no second picture; give it to generate()",
            field="frame_interval",
        )
    pixels = pixels_at(scene, image, picture, image.frame.time + interval)
    return encode(pixels, picture.format, picture.quality)
