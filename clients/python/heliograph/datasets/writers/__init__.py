"""The writers: hd.Coco(...), hd.Bop(...). Their base is heliograph.datasets.writer.Writer."""

from .bop import Bop
from .coco import Coco
from .colmap import Colmap
from .exr import Exr
from .kitti import Kitti
from .middlebury import Middlebury
from .ndds import Ndds
from .nerf import NerfTransforms
from .parquet import Parquet
from .tapvid import TapVid
from .webdataset import WebDataset
from .yolo import Yolo

__all__ = [
    "Bop",
    "Coco",
    "Colmap",
    "Exr",
    "Kitti",
    "Middlebury",
    "Ndds",
    "NerfTransforms",
    "Parquet",
    "TapVid",
    "WebDataset",
    "Yolo",
]
