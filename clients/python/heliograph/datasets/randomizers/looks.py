"""random_materials, random_textures: materials of things."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidArgument
from ...scene.handles import Entity, Handle, Material, Texture, flatten
from ...values.components import Tex
from . import ranges
from .patterns import bundled_textures
from .pictures import CACHE_BYTES, Pictures
from .ranges import Choice, HsvColor, LogUniform, Range

if TYPE_CHECKING:
    from ..draw import Draw

_COLOR, _METALLIC, _SCALE = HsvColor(), Choice(0.0, 0.0, 1.0), LogUniform(0.5, 4.0)
_COLORS = ("base_color", "emission", "subsurface_color", "specular_color")
_ENDINGS = (".png", ".jpg", ".jpeg", ".exr", ".hdr")


class RandomMaterials:
    """Gives things new materials, or materials new parameters.

    things: entities, groups, assets, each of which gets a material of its own for all its meshes;
    or materials, which are changed for all who use them. base_color and other colours: (r, g, b)
    linear, a pair of these, uniform between them, or a callable; further parameters are Ranges, by
    the names of edit.material(). None: as it is.
    """

    def __init__(
        self,
        things: Any,
        *,
        base_color: Any = _COLOR,
        metallic: Range | None = _METALLIC,
        roughness: Range | None = (0.05, 0.9),
        **parameters: Any,
    ) -> None:
        self.things = things
        given = {
            "base_color": base_color,
            "metallic": metallic,
            "roughness": roughness,
            **parameters,
        }
        self.parameters = {
            name: ranges.checked_color(value, name)
            if name in _COLORS
            else ranges.checked_range(value, name)
            for name, value in given.items()
            if value is not None
        }

    def __call__(self, draw: Draw) -> None:
        for material in materials_of(draw, self.things):
            values: dict[str, Any] = {}
            for name, value in self.parameters.items():
                if name in _COLORS:
                    values[name] = tuple(ranges.color(draw.rng, value))
                else:
                    values[name] = ranges.number(draw.rng, value)
            draw.edit.material(material, **values)


class RandomTextures:
    """Puts one of several pictures onto things as their base colour.

    things: as of RandomMaterials; their meshes need texture coordinates. images: files, arrays, a
    folder, or textures of the scene; default: bundled_textures(). scale: how often the picture is
    repeated over one unit of the coordinates. tint: a colour that multiplies it. It is turned and
    shifted at random. cache_bytes: as of RandomDome.
    """

    def __init__(
        self,
        things: Any,
        images: Any = None,
        *,
        scale: Range = _SCALE,
        tint: Any = (1.0, 1.0, 1.0),
        cache_bytes: int = CACHE_BYTES,
    ) -> None:
        self.things = things
        self.scale = ranges.checked_range(scale, "scale", 1e-6)
        self.tint = ranges.checked_color(tint, "tint")
        listed = [images] if isinstance(images, Texture) else images
        self._handles = isinstance(listed, Sequence) and any(isinstance(t, Texture) for t in listed)
        if self._handles and not all(isinstance(t, Texture) for t in listed):
            raise InvalidArgument(
                "images: has textures of the scene and other pictures; give one kind",
                field="images",
            )
        if listed is None:
            listed = bundled_textures()
        self._images: Any = listed if self._handles else Pictures(listed, _ENDINGS, cache_bytes)

    def __call__(self, draw: Draw) -> None:
        made: dict[int, Any] = {}
        for material in materials_of(draw, self.things):
            choice = int(draw.rng.integers(len(self._images)))
            if choice not in made:
                made[choice] = self._texture(draw, choice)
            texture = made[choice]
            scale = ranges.number(draw.rng, self.scale)
            turn = ranges.turn(np.array([0.0, 0, 1]), 2 * np.pi * draw.rng.random())[:2, :2]
            uv = np.column_stack([scale * turn, draw.rng.random(2)])
            tint = tuple(ranges.color(draw.rng, self.tint))
            draw.edit.material(material, base_color=Tex(texture, factor=tint, uv=uv))

    def _texture(self, draw: Draw, choice: int) -> Any:
        if self._handles:
            return self._images[choice]
        texels, encoded = self._images.texels(draw.scene.client, choice)
        encoding = "srgb" if encoded else "linear"
        return draw.edit.texture(draw.fresh("random/picture"), texels, encoding=encoding)


def materials_of(draw: Draw, things: Any) -> Iterator[Material]:
    """Materials as they are; of each entity one of its own, which the overlay makes and binds."""
    for thing in flatten(things, "things"):
        handle = draw.scene[thing] if isinstance(thing, str) else thing
        if isinstance(handle, Material):
            yield handle
        elif isinstance(handle, Entity):
            name = f"random/material/{handle.name or handle.id}"
            own = draw.edit.material(name)
            (body,) = draw.bodies.of(handle, "things")
            for mesh in body.meshes:
                draw.edit.update(mesh, material=own)
            yield own
        else:
            raise InvalidArgument(
                f"things: needs entities or materials, not {_described(handle)}", field="things"
            )


def _described(handle: Handle) -> str:
    return f"{handle!r}, a {handle.kind}"
