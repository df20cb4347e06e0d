"""Table of all formats, by name."""

from __future__ import annotations

from .dataset import FORMAT
from .formats import Format
from .written import WRITTEN

FORMATS: dict[str, Format] = {**WRITTEN, FORMAT.name: FORMAT}
