"""Packages that not every installation has."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import Unimplemented


def needed(package: str, what: str, extra: str) -> Any:
    """Imports a package. Unimplemented names the feature that needs it and the command to install
    it."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise Unimplemented(
            f"{what} the package {package}: pip install 'heliograph[{extra}]'"
        ) from None


def openexr() -> Any:
    return needed("OpenEXR", "EXR files need", "exr")


def pyarrow() -> Any:
    found = needed("pyarrow", "Parquet files need", "datasets")
    importlib.import_module("pyarrow.parquet")
    return found
