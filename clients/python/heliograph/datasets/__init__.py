"""Labelled data sets: randomize a scene, render it, write it in a format that trainers read.

`import heliograph.datasets as hd`; docs/datasets.md is its guide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bop import Bop
    from .coco import Coco
    from .colmap import Colmap
    from .draw import Compose, Draw
    from .exr import Exr
    from .generating import Summary, generate
    from .kept import KeptImage
    from .kitti import Kitti
    from .middlebury import Middlebury
    from .ndds import Ndds
    from .nerf import NerfTransforms
    from .parquet import Parquet
    from .randomizers import *  # noqa: F403
    from .tapvid import TapVid
    from .validation import Fault, Report, validate
    from .webdataset import WebDataset
    from .writer import Dataset, Image, Picture, Records, Writer
    from .yolo import Yolo

_RANDOMIZERS = (
    "DomeScene",
    "FatScene",
    "MeshScene",
    "add_wares",
    "make_scene",
    "add_distractors",
    "bundled_domes",
    "bundled_textures",
    "camera_path",
    "choice",
    "distractors",
    "hsv_color",
    "in_view",
    "in_volume",
    "log_uniform",
    "look_at_jitter",
    "orbit",
    "random_dome",
    "random_joints",
    "random_lights",
    "random_materials",
    "random_motion",
    "random_shape",
    "random_textures",
    "scatter",
    "settle",
    "shell",
)
_HOMES = {
    "Bop": "bop",
    "Coco": "coco",
    "Colmap": "colmap",
    "Compose": "draw",
    "Dataset": "writer",
    "Draw": "draw",
    "Exr": "exr",
    "Fault": "validation",
    "Image": "writer",
    "KeptImage": "kept",
    "Kitti": "kitti",
    "Middlebury": "middlebury",
    "Ndds": "ndds",
    "NerfTransforms": "nerf",
    "Parquet": "parquet",
    "Picture": "writer",
    "Records": "writer",
    "Report": "validation",
    "Summary": "generating",
    "TapVid": "tapvid",
    "WebDataset": "webdataset",
    "Writer": "writer",
    "Yolo": "yolo",
    "generate": "generating",
    "validate": "validation",
    **dict.fromkeys(_RANDOMIZERS, "randomizers"),
}

__all__ = [
    "Bop",
    "Coco",
    "Colmap",
    "Compose",
    "Dataset",
    "Draw",
    "Exr",
    "Fault",
    "Image",
    "KeptImage",
    "Kitti",
    "Middlebury",
    "Ndds",
    "NerfTransforms",
    "Parquet",
    "Picture",
    "Records",
    "Report",
    "Summary",
    "TapVid",
    "WebDataset",
    "Writer",
    "Yolo",
    "generate",
    "validate",
    *_RANDOMIZERS,
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'heliograph.datasets' has no attribute {name!r}")
    import importlib

    home = importlib.import_module(f"{__name__}.{_HOMES[name]}")
    found = globals()[name] = getattr(home, name)
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
