"""All formats, by name."""

from __future__ import annotations

from . import bop, coco, colmap, dataset, flo, kitti, ndds, nerf, tapvid, yolo
from .formats import Format

_MODULES = (coco, bop, kitti, flo, ndds, yolo, tapvid, nerf, colmap, dataset)

FORMATS: dict[str, Format] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
