"""All formats, by name."""

from __future__ import annotations

from . import bop, coco, dataset
from .formats import Format

_MODULES = (coco, bop, dataset)

FORMATS: dict[str, Format] = {module.FORMAT.name: module.FORMAT for module in _MODULES}
