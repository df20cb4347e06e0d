"""Household goods made of numbers, with printed labels: the default of scene generators without
models."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...scene.handles import Entity, Group
from ...values import shapes
from ...values.checks import whole_of
from ...values.components import Tex
from ..randomizers.patterns import palette
from ..randomizers.props import rounded, surface, turned

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ...scene.patches import Geometry

_SEGMENTS = 64
_PRINT = (512, 1024)  # rows, columns of a label


def add_wares(edit: Edits, count: int = 12, *, seed: int = 0) -> Group:
    """Entities "ware/0" .. about the origin, standing: can, carton, bottle, mug, bowl, ball in
    turn, each a category, 7 to 24 cm large, in three prints. The seed determines them."""
    made: list[Entity] = []
    looks: dict[tuple[str, int], tuple[Any, Any]] = {}
    edit.categories(*_MAKERS)
    for i in range(whole_of(count, "count", 1)):
        kind = tuple(_MAKERS)[i % len(_MAKERS)]
        variant = i // len(_MAKERS) % 3
        if (kind, variant) not in looks:
            rng = np.random.default_rng((seed, i % len(_MAKERS), variant))
            name = f"ware/{kind}{variant}"
            geometry, material = _MAKERS[kind](edit, rng, name)
            looks[kind, variant] = (
                edit.mesh(f"{name}/mesh", **geometry),
                edit.material(f"{name}/material", **material),
            )
        mesh, material = looks[kind, variant]
        made.append(edit.entity(f"ware/{i}", mesh=mesh, material=material, category=kind))
    return Group(made, "ware")


def _print(rng: np.random.Generator, text: str) -> NdArray:
    """(512, 1024, 3) uint8: a printed label, seamless from left to right, its name twice."""
    from PIL import Image, ImageDraw

    rows, columns = _PRINT
    dark, light = (tuple(int(255 * c) for c in color) for color in palette(rng))
    accent = tuple(int(255 * c) for c in palette(rng)[1])
    image = Image.new("RGB", (columns, rows), light if rng.random() < 0.5 else accent)
    pen = ImageDraw.Draw(image)
    for _ in range(int(rng.integers(1, 4))):
        y = int(rng.integers(0, rows))
        pen.rectangle((0, y, columns, y + int(rng.integers(8, 90))), fill=accent)
    for half in (0, columns // 2):
        pen.rectangle((half + 60, 150, half + 452, 360), fill=dark)
        word = Image.new("L", (8 * len(text), 12), 0)
        ImageDraw.Draw(word).text((1, 0), text.upper(), fill=255)
        box = word.getbbox()
        word = word.crop(box).resize((340, 120), Image.Resampling.BICUBIC)
        image.paste(Image.new("RGB", word.size, light), (half + 86, 195), word)
        pen.ellipse((half + 200, 385, half + 312, 470), fill=dark)
        for i in range(14):  # a bar code
            x = half + 380 + 7 * i
            pen.rectangle((x, 390, x + int(rng.integers(1, 5)), 460), fill=(20, 20, 20))
    return np.asarray(image)


def _upright(profile: NdArray) -> Geometry:
    """A turned body whose v is its height over all, from 0 to 1."""
    geometry = turned(profile, _SEGMENTS)
    height = np.asarray(geometry["positions"])[:, 2]
    uvs = np.asarray(geometry["uvs"]).copy()
    uvs[:, 1] = (height - height.min()) / np.ptp(height)
    return {**geometry, "uvs": uvs}


def _polygon(*points: tuple[float, float], radius: float = 0.004) -> NdArray:
    return rounded(np.array(points), radius)


def _can(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    """Printed tin with bare metal at both ends, as a texture of `metallic` has it."""
    radius, height = rng.uniform(0.03, 0.045), rng.uniform(0.07, 0.13)
    profile = _polygon(
        *[(0, 0.003), (radius - 0.004, 0.003), (radius - 0.003, 0), (radius, 0)],
        *[(radius, height), (radius - 0.003, height), (radius - 0.004, height - 0.003)],
        *[(0, height - 0.003)],
        radius=0.0015,
    )
    printed = _print(rng, "can").copy()
    printed[:36], printed[-36:] = 205, 205
    mask = np.zeros(_PRINT, "u1")
    mask[:36], mask[-36:] = 255, 255
    base = edit.texture(f"{name}/print", printed)
    metal = edit.texture(f"{name}/metal", mask, encoding="linear")
    return _upright(profile), {
        "base_color": base,
        "metallic": Tex(metal),
        "roughness": float(rng.uniform(0.2, 0.35)),
    }


def _carton(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    size = np.array([rng.uniform(0.1, 0.16), rng.uniform(0.04, 0.07), rng.uniform(0.14, 0.22)])
    cube = shapes.cube()
    positions = (np.asarray(cube["positions"]) * size + (0, 0, 0.5 * size[2])).astype("<f4")
    uvs = np.asarray(cube["uvs"]) * (0.5, 1.0)  # one face shows the name once
    picture = edit.texture(f"{name}/print", _print(rng, "oats"))
    material = {"base_color": picture, "roughness": float(rng.uniform(0.4, 0.7))}
    return {**cube, "positions": positions, "uvs": uvs.astype("<f4")}, material


def _bottle(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    radius, height = rng.uniform(0.028, 0.038), rng.uniform(0.18, 0.24)
    neck = 0.38 * radius
    profile = _polygon(
        *[(0, 0), (radius, 0), (radius, 0.6 * height), (neck, 0.82 * height)],
        *[(neck, 0.9 * height), (1.25 * neck, 0.9 * height), (1.25 * neck, height), (0, height)],
        radius=0.012,
    )
    picture = _print(rng, "soap").copy()
    picture[: _PRINT[0] // 3] = picture[5, 5]
    return _upright(profile), {
        "base_color": edit.texture(f"{name}/print", picture),
        "roughness": float(rng.uniform(0.1, 0.3)),
    }


def _mug(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    radius, height, wall = rng.uniform(0.036, 0.045), rng.uniform(0.08, 0.1), 0.004
    profile = _polygon(
        *[(0, 0), (radius, 0), (radius, height), (radius - wall, height)],
        *[(radius - wall, wall), (0, wall)],
    )
    cup = _upright(profile)
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(-0.5, 0.5, 33) * np.pi)
    ring = 0.028 + 0.0055 * np.cos(around)
    handle = surface(
        np.stack(
            [
                radius - wall / 2 + ring * np.cos(along),
                0.0055 * np.sin(around),
                0.5 * height + ring * np.sin(along),
            ],
            axis=-1,
        )
    )
    return _joined(cup, handle), _glazed(edit, rng, name)


def _joined(a: Geometry, b: Geometry) -> Geometry:
    start = np.uint32(len(np.asarray(a["positions"])))
    out: Geometry = {"indices": np.concatenate([a["indices"], np.asarray(b["indices"]) + start])}
    for key in ("positions", "normals", "uvs"):
        out[key] = np.concatenate([a[key], b[key]])
    return out


def _glazed(edit: Edits, rng: np.random.Generator, name: str) -> dict[str, Any]:
    """Ceramic in two colours, one above the other."""
    dark, light = palette(rng)
    rows = np.linspace(0, 1, 64)[:, None] > rng.uniform(0.35, 0.75)
    picture = (255 * np.where(rows, dark, light)).astype("u1")[:, None].repeat(4, axis=1)
    glaze = edit.texture(f"{name}/glaze", picture, wrap="clamp")
    return {"base_color": glaze, "roughness": float(rng.uniform(0.08, 0.25))}


def _bowl(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    radius, height, wall = rng.uniform(0.06, 0.08), rng.uniform(0.045, 0.065), 0.004
    turn = np.linspace(0.3, 0.5 * np.pi, 16)
    outer = np.column_stack([radius * np.sin(turn), height * (1 - np.cos(turn))])
    outer[:, 1] -= outer[0, 1]
    inner = (outer * ((radius - wall) / radius, 1) + (0, wall))[::-1]
    inner[0] = (radius - wall, outer[-1, 1])
    profile = np.concatenate([[(0, 0)], outer, inner, [(0, wall)]])
    return _upright(profile), _glazed(edit, rng, name)


def _ball(edit: Edits, rng: np.random.Generator, name: str) -> tuple[Geometry, dict[str, Any]]:
    ball = shapes.sphere(float(rng.uniform(0.035, 0.05)), segments=48)
    dark, light = palette(rng)
    sectors = (np.arange(64) // 8 % 2)[None, :, None]
    picture = (255 * np.where(sectors, dark, light)).astype("u1").repeat(8, axis=0)
    positions = np.asarray(ball["positions"])
    positions = positions - (0, 0, positions[:, 2].min())
    rubber = edit.texture(f"{name}/sectors", picture, filter="nearest")
    material = {"base_color": rubber, "roughness": float(rng.uniform(0.3, 0.6))}
    return {**ball, "positions": positions.astype("<f4")}, material


_Maker = Callable[["Edits", np.random.Generator, str], "tuple[Geometry, dict[str, Any]]"]
_MAKERS: dict[str, _Maker] = {
    "can": _can,
    "carton": _carton,
    "bottle": _bottle,
    "mug": _mug,
    "bowl": _bowl,
    "ball": _ball,
}
