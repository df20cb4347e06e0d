"""Settings of scenes: by name, in TOML files, as TOML."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from pathlib import Path
from typing import Any

from ...errors import InvalidArgument
from .dome import DomeScene
from .fat import FatScene
from .mesh import MeshScene
from .paper import PaperScene

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES: dict[str, type[PaperScene]] = {"dome": DomeScene, "mesh": MeshScene, "fat": FatScene}


def make_scene(name: str, **settings: Any) -> PaperScene:
    """The scene "dome", "mesh" or "fat" with some of its settings."""
    if name not in SCENES:
        raise InvalidArgument(f"scene: one of {', '.join(SCENES)}, not {name!r}", field="scene")
    known = [field.name for field in dataclasses.fields(SCENES[name])]
    for key in settings:
        if key not in known:
            raise InvalidArgument(
                f"{key}: {name} has no such setting; it has {', '.join(known)}", field=key
            )
    return SCENES[name](**settings)


def read_settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The settings in a TOML file; files in it are relative to it."""
    path = Path(path)
    try:
        settings = tomllib.loads(path.read_text("utf-8"))
    except ValueError as error:  # no TOML, or no text
        raise InvalidArgument(f"{path}: {error}", field="config") from None
    for key in ("models", "domes"):
        if key in settings:
            settings[key] = _beside(path.absolute(), settings[key])
    return settings


def _beside(path: Path, names: Any) -> Any:
    """Paths relative to a file; make_scene() refuses anything but a list of them."""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return names
    return [str(path.parent / name) for name in names]


def settings_text(scene: PaperScene) -> str:
    """Settings as TOML: numbers, texts and arrays are written as JSON's are."""
    lines = []
    for field in dataclasses.fields(scene):
        value = getattr(scene, field.name)
        lines.append(f"{field.name} = {json.dumps(value)}")
    return "\n".join(lines) + "\n"
