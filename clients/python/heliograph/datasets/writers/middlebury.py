"""Middlebury: optical flow in .flo files. docs/datasets.md, "Middlebury"."""

from __future__ import annotations

import os
from typing import Any

from ...errors import InvalidArgument
from ..writer import Image, Picture, Writer
from .encoded import flo
from .later import second_picture

_PLANES = ("flow_forward", "flow_forward_valid")


class Middlebury(Writer):
    """Optical flow in the layout of the Middlebury benchmark (Baker et al. 2011): other-data/000123
    with frame10.png and frame11.png, other-gt-flow/000123/flow10.flo from the first to the second.

    Flow is in pixels, u right, v down; undefined flow is 1e10. Give generate() a frame_interval,
    and hold=True if entities without keys stand still. With splits their names come before the
    images': other-data/train/000123.
    """

    picture: Picture

    def __init__(
        self, directory: str | os.PathLike[str], *, picture: Picture | str = "png"
    ) -> None:
        super().__init__(directory, picture=picture)
        if self.picture.format != "png":
            raise InvalidArgument("picture: Middlebury's are PNG files", field="picture")
        self.planes = (*self.picture.planes, *_PLANES)

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        name = "/".join(part for part in (image.split, image.name) if part)
        flow, valid = (frame[plane] for plane in _PLANES)
        self.put(f"other-gt-flow/{name}/flow10.flo", flo(flow, valid))
        self.put(f"other-data/{name}/frame10.png", self.picture.encode(frame))
        second = second_picture(self.dataset.scene, image, self.picture)
        self.put(f"other-data/{name}/frame11.png", second)
        return {"defined": int((valid != 0).sum())}
