"""heliograph.datasets is not in this version; using a name of it says so."""

from __future__ import annotations

from typing import NoReturn

from .errors import Unimplemented


def __getattr__(name: str) -> NoReturn:
    if name.startswith("__"):
        raise AttributeError(name)
    raise Unimplemented(
        f"heliograph.datasets.{name} arrives with the issue Training data; until then write a loop "
        "over scene.render() and scene.overlay(): see examples/randomize.py"
    )
