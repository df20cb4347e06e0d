"""The formats that writers make, by name."""

from __future__ import annotations

from . import (
    bop,
    coco,
    colmap,
    exr,
    flo,
    frame,
    kitti,
    ndds,
    nerf,
    parquet,
    tapvid,
    webdataset,
    yolo,
)
from .formats import Format

_MODULES = (
    coco,
    bop,
    kitti,
    flo,
    ndds,
    yolo,
    tapvid,
    nerf,
    colmap,
    exr,
    webdataset,
    parquet,
    frame,
)

WRITTEN: dict[str, Format] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
