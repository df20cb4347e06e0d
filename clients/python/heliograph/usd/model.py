"""Model of a USD stage in this project's terms: metres and +Z up from the root on. Made by
stage.read(), put into scenes by build.Builder. Knows nothing of pxr."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from .._wire.arrays import NdArray
from ..values.components import Tex

if TYPE_CHECKING:
    from ..robots.description import RobotModel
    from ..scene.patches import Geometry

NIT = 1 / 683  #: W sr^-1 m^-2 in each channel of white of 1 cd/m^2
Pose = Union[NdArray, Mapping[float, NdArray]]  # (4, 4), or keys {seconds: (4, 4)}


class Notes:
    """Notes on what is left out or assumed: one text, many prims."""

    def __init__(self) -> None:
        self._prims: dict[str, dict[str, None]] = {}

    def add(self, prim: Any, text: str) -> None:
        """prim: its path, or an object with GetPath()."""
        path = str(prim.GetPath()) if hasattr(prim, "GetPath") else str(prim)
        self._prims.setdefault(text, {})[path] = None

    def texts(self) -> list[str]:
        """ "/World/Lamp: text", or "/World/Lamp and 3 more: text"."""
        found = []
        for text, prims in self._prims.items():
            more = f" and {len(prims) - 1} more" if len(prims) > 1 else ""
            found.append(f"{next(iter(prims))}{more}: {text}")
        return found


@dataclass(frozen=True)
class Image:
    """A texture's file and how it is read; encoding None: by its bit depth."""

    file: Path
    encoding: str | None = None
    wrap: tuple[str, str] = ("repeat", "repeat")


@dataclass(frozen=True)
class Sampled(Tex):
    """A texture that is not made yet: its image. fallback: the parameter when that cannot be
    read."""

    texture: Image
    fallback: Any = None


@dataclass
class Look:
    """A material. parameters: constants and Sampled. primvars: names of its texture coordinates,
    two at most, in the order of uv_set. colors: it shows the primvar displayColor."""

    parameters: dict[str, Any] = field(default_factory=dict)
    primvars: list[str] = field(default_factory=list)
    colors: bool = False


@dataclass
class Node:
    """An entity. parent: the path of another node, None: the root. transforms: (N, 4, 4) of a
    packed group instead of a pose. mesh, looks: keys of the model's. rest: more Components."""

    path: str
    parent: str | None
    pose: Pose = field(default_factory=lambda: np.eye(4))
    transforms: NdArray | None = None
    mesh: str | None = None
    looks: Sequence[str] = ()
    joints: tuple[Sequence[str], NdArray] | None = None  # paths of nodes, inverse binds
    rest: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Articulation:
    """Bodies that joints connect. path: its key. above: the path of the node that it is beneath,
    None: the root; pose: (4, 4) of its first link there. bodies: by the path of their nodes the
    link, and (4, 4) link_from_node. targets: of drives, by the joint's name. category: that of its
    instance, "": that of the call."""

    path: str
    above: str | None
    pose: NdArray
    robot: RobotModel
    bodies: Mapping[str, tuple[str, NdArray]]
    targets: Mapping[str, float]
    category: str = ""


@dataclass
class Dome:
    """Light from infinitely far. rotation: (3, 3) root_from_dome."""

    image: Path | None
    options: dict[str, Any]
    rotation: NdArray


@dataclass
class Model:
    """A stage as it was read."""

    stem: str
    metres_per_unit: float
    up: str
    nodes: list[Node] = field(default_factory=list)
    meshes: dict[str, Geometry] = field(default_factory=dict)
    looks: dict[str, Look] = field(default_factory=dict)
    articulations: list[Articulation] = field(default_factory=list)
    dome: Dome | None = None
    notes: Notes = field(default_factory=Notes)


@dataclass(frozen=True)
class Options:
    """Options of import_usd()."""

    variants: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    payloads: bool = True
    purposes: Sequence[str] = ("default", "render")
    time: float | None = None
    times: Any = None
    units: float = 0.0
    folders: Sequence[Path] = field(default_factory=list)
    semantics: str | None = "class"
    nit: float = NIT
    lights: bool = True
    camera_width: int = 960
    subdivision: int = 0
