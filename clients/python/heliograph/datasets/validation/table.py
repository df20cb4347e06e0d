"""All formats, by name."""

from __future__ import annotations

from . import coco, dataset
from .formats import Format

FORMATS: dict[str, Format] = {module.FORMAT.name: module.FORMAT for module in (coco, dataset)}
