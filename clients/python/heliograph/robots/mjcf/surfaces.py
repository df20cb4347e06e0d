"""Visible geoms and sites: places and materials. Used by edits.py."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .geometry import Shape, kind_of
from .looks import Look, is_flat, look_of, texture_of
from .reading import Compiled, pose

_MIRRORS = ("plane", "box")  # kinds that MuJoCo shows reflectance of


@dataclass(frozen=True, eq=False)
class Surface:
    """kind: "geom" or "site". pose: (4, 4) body_from_surface."""

    kind: str
    name: str
    pose: NdArray
    shape: Shape
    look: Look


def by_body(source: Compiled, groups: Sequence[int], sites: bool) -> dict[int, list[Surface]]:
    found: dict[int, list[Surface]] = defaultdict(list)
    for kind in ("geom", "site") if sites else ("geom",):
        body = getattr(source.model, f"{kind}_bodyid")
        for index, surface in _surfaces(source, kind, groups):
            found[int(body[index])].append(surface)
    return found


def _surfaces(source: Compiled, kind: str, groups: Sequence[int]) -> Iterator[tuple[int, Surface]]:
    count = getattr(source.model, f"n{kind}")
    for index, name in enumerate(source.names(kind, count)):
        if getattr(source.model, f"{kind}_group")[index] in groups:
            surface = _surface(source.model, kind, index, name)
            if surface.look.rgba[3] > 0:
                yield index, surface


def _surface(model: Any, kind: str, index: int, name: str) -> Surface:
    def of(field: str) -> Any:
        return getattr(model, f"{kind}_{field}")[index]

    what = kind_of(of("type"))
    look = look_of(model, int(of("matid")), of("rgba"), what in _MIRRORS)
    data = int(model.geom_dataid[index]) if kind == "geom" else _data_of_site(model, index)
    size = tuple(np.array(of("size"), "f8").tolist())
    repeat, cube = _picture(model, look, size)
    if what == "mesh" and repeat is None:
        size = (0.0, 0.0, 0.0)  # one mesh for all
    uniform = cube is not None and bool(model.mat_texuniform[look.material])
    shape = Shape(what, size, data, repeat, cube, uniform)
    return Surface(kind, name, pose(of("pos"), of("quat")), shape, look)


def _data_of_site(model: Any, index: int) -> int:
    return int(model.site_dataid[index]) if hasattr(model, "site_dataid") else -1


def _picture(
    model: Any, look: Look, size: tuple[float, ...]
) -> tuple[tuple[float, float] | None, tuple[int, int] | None]:
    """Layout of a texture on a surface: Shape.repeat and Shape.cube."""
    texture = texture_of(model, look)
    if texture < 0:
        return None, None
    if not is_flat(model, texture):
        side = int(model.tex_width[texture])
        return None, (int(model.tex_height[texture]) // side, side)
    repeat = np.array(model.mat_texrepeat[look.material], "f8")
    if model.mat_texuniform[look.material]:
        half = np.array(size[:2])
        repeat = repeat * np.where(half > 0, half, 1.0)
    return (float(repeat[0]), float(repeat[1])), None


def hidden(source: Compiled, groups: Sequence[int], sites: bool) -> list[str]:
    """Warnings of geoms, sites, tendons and skins that are not shown."""
    out = []
    for kind in ("geom", "site", "tendon", "skin"):
        count = getattr(source.model, f"n{kind}")
        if kind == "site" and not sites:
            out += [f"{count} sites are left out; sites=True shows them"] if count else []
            continue
        of = np.array(getattr(source.model, f"{kind}_group"), int)
        left = sorted({int(g) for g in of[~np.isin(of, groups)]})
        if left:
            number = int((~np.isin(of, groups)).sum())
            listed = ", ".join(map(str, left))
            out.append(f"{number} {kind}s of groups {listed} are left out; see groups=")
    return out
