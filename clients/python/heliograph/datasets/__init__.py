"""Labelled data sets: randomize a scene, render it, write it in a format that trainers read.

`import heliograph.datasets as hd`; docs/datasets.md is its guide.
"""

from . import randomizers, scenes, writers
from .draw import Compose, Draw
from .generating import Summary, generate
from .kept import KeptImage
from .randomizers import *  # noqa: F403
from .scenes import *  # noqa: F403
from .validation import Fault, Report, validate
from .writer import Dataset, Image, Picture, Records, Writer
from .writers import *  # noqa: F403

__all__ = [
    "Compose",
    "Dataset",
    "Draw",
    "Fault",
    "Image",
    "KeptImage",
    "Picture",
    "Records",
    "Report",
    "Summary",
    "Writer",
    "generate",
    "validate",
]
__all__ += randomizers.__all__
__all__ += scenes.__all__
__all__ += writers.__all__
