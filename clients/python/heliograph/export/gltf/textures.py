"""Textures of glTF: as they are where a parameter lies in the channel that glTF names, else made
anew. Source: glTF 2.0, 3.8 and 3.9; KHR_texture_transform."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...image import png
from ..looks import Field, Picture, Use, picture_of, quantized, to_srgb
from ..world import World
from .document import Document

_WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_LINEAR, _NEAREST, _MIPMAPS = 9729, 9728, 9987
_SHEAR = 1e-5
_CHANNELS = "rgba"

Parts = Mapping[str, Field]  # "rgb", "r", "g", "b", "a" to the parameter that lies there


class Textures:
    """Puts images and textures into a document, each once."""

    def __init__(self, world: World, document: Document) -> None:
        self.world = world
        self.document = document
        self._pictures: dict[int, Picture] = {}
        self._images: dict[Any, int] = {}
        self._textures: dict[tuple[int, int], int] = {}
        self._samplers: dict[tuple[Any, ...], int] = {}

    def picture(self, key: int) -> Picture:
        if key not in self._pictures:
            self._pictures[key] = picture_of(self.world, key)
        return self._pictures[key]

    # ------------------------------------------------------------ what a slot shows

    def packed(
        self, owner: str, parts: Parts, *, srgb: bool = False, peak: bool = False
    ) -> tuple[dict[str, Any] | None, dict[str, Any]]:
        """A texture's info, None: none is needed, and the factor of each part.

        srgb: of the slot's colours. peak: values may exceed 1, then the factor does.
        """
        fields = {place: self._constant(field) for place, field in parts.items()}
        lead = next((field.use for field in fields.values() if field.use), None)
        if lead is None:
            return None, {place: field.value for place, field in fields.items()}
        fields = {place: self._beside(owner, lead, field) for place, field in fields.items()}
        if self._fits(fields, srgb):
            return self._as_it_is(owner, lead, fields)
        return self._made(owner, lead, fields, srgb, peak)

    def _constant(self, field: Field) -> Field:
        """Field without its texture, where that lacks the alpha that is asked for, or is multiplied
        by 0."""
        use = field.use
        if use is None or (not field.is_zero and not self._lacks(use)):
            return field
        return Field(np.multiply(field.value, use.scale + use.offset))

    def _lacks(self, use: Use) -> bool:
        return use.channel == 3 and not self.picture(use.texture).has_alpha()

    def _beside(self, owner: str, lead: Use, field: Field) -> Field:
        """A field whose texture lies as the leading one does; else its mean."""
        use = field.use
        if use is None or self._lies(use) == self._lies(lead):
            return field
        self.world.notes.add(
            owner, "parameters of one glTF texture lie otherwise: the mean of one is taken"
        )
        return Field(self.mean(field))

    def mean(self, field: Field) -> Any:
        """Mean of a field with a texture: a number or (3,)."""
        found = self._values(field).reshape(-1, *np.shape(field.value)).mean(axis=0, dtype="f8")
        return found if np.ndim(found) else float(found)

    def _lies(self, use: Use) -> tuple[Any, ...]:
        return (use.uv, use.uv_set, *self.picture(use.texture).layout)

    def _fits(self, fields: Parts, srgb: bool) -> bool:
        """True if one picture has all fields in its places, and no constant changes by it."""
        used = [field.use for field in fields.values() if field.use]
        if len({use.texture for use in used}) > 1:
            return False
        picture = self.picture(used[0].texture)
        return picture.has_levels and all(
            self._fits_place(place, field, picture, srgb) for place, field in fields.items()
        )

    def _fits_place(self, place: str, field: Field, picture: Picture, srgb: bool) -> bool:
        use = field.use
        if use is None:
            return field.is_zero or (place == "a" and not picture.has_alpha())
        factor = np.multiply(field.value, use.scale)
        if use.offset != 0 or factor.min() < 0 or factor.max() > 1:
            return False
        if place == "a":
            return use.channel == 3
        in_place = place == "rgb" or use.channel == _CHANNELS.index(place)
        is_grey = picture.texels.shape[2] < 3 and use.channel < 3
        return picture.srgb == srgb and (in_place or is_grey)

    def _as_it_is(
        self, owner: str, lead: Use, fields: Parts
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        picture = self.picture(lead.texture)
        if lead.texture not in self._images:
            self._images[lead.texture] = self._image(picture.name, picture.texels)
        factors = {
            place: np.multiply(field.value, field.use.scale if field.use else 1.0)
            for place, field in fields.items()
        }
        return self._info(owner, lead, self._images[lead.texture]), factors

    # ------------------------------------------------------------ what is made

    def _made(
        self, owner: str, lead: Use, fields: Parts, srgb: bool, peak: bool
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """A picture of the values themselves."""
        pictures = [self.picture(field.use.texture) for field in fields.values() if field.use]
        values = {place: self._values(field) for place, field in fields.items() if field.use}
        most = {place: max(1.0, float(one.max())) if peak else 1.0 for place, one in values.items()}
        size = tuple(max(p.texels.shape[i] for p in pictures) for i in (0, 1))
        levels = np.ones((*size, 4 if "a" in fields else 3), "f4")
        for place, one in values.items():
            level = _resized(np.clip(one / most[place], 0, 1), size)
            at = slice(0, 3) if place == "rgb" else _CHANNELS.index(place)
            levels[..., at] = to_srgb(level) if srgb and place != "a" else level
        texels = quantized(levels, self._is_deep(owner, pictures, srgb))
        factors = {
            place: np.full(np.shape(field.value), most[place]) if place in most else field.value
            for place, field in fields.items()
        }
        return self._info(owner, lead, self._made_image(owner, texels)), factors

    def _values(self, field: Field) -> NdArray:
        assert field.use is not None
        is_color = np.ndim(field.value) > 0
        values = self.picture(field.use.texture).values(field.use, is_color)
        return np.asarray(values * np.asarray(field.value, "f4"))

    def _is_deep(self, owner: str, pictures: list[Picture], srgb: bool) -> bool:
        """True if 8 bits would lose something."""
        if not all(picture.has_levels for picture in pictures):
            self.world.notes.add(owner, "textures of floats are written with 16 bits")
        return any(p.texels.dtype != np.uint8 or p.srgb != srgb for p in pictures)

    def _made_image(self, owner: str, texels: NdArray) -> int:
        key = texels.tobytes(), texels.shape
        if key not in self._images:
            self._images[key] = self._image(owner, texels)
        return self._images[key]

    def normal_map(self, owner: str, use: Use) -> dict[str, Any]:
        """The info of a normal map, its strength as `scale`."""
        picture = self.picture(use.texture)
        if picture.has_levels and not picture.srgb:
            info, _ = self._as_it_is(owner, use, {"rgb": Field((1.0, 1.0, 1.0))})
        else:
            texels = quantized(picture.rgba()[..., :3], self._is_deep(owner, [picture], False))
            info = self._info(owner, use, self._made_image(owner, texels))
        return {**info, "scale": use.scale}

    # ------------------------------------------------------------ the document

    def _image(self, name: str, texels: NdArray) -> int:
        pixels = texels[..., 0] if texels.shape[2] == 1 else texels
        view = self.document.view(png.encode(pixels))
        found = {"bufferView": view, "mimeType": "image/png"}
        return self.document.add("images", {**found, "name": name} if name else found)

    def _info(self, owner: str, use: Use, image: int) -> dict[str, Any]:
        key = image, self._sampler(self.picture(use.texture))
        if key not in self._textures:
            self._textures[key] = self.document.add(
                "textures", {"source": key[0], "sampler": key[1]}
            )
        found: dict[str, Any] = {"index": self._textures[key]}
        if use.uv_set:
            found["texCoord"] = use.uv_set
        transform = self._transform(owner, use) if use.is_turned else None
        if transform is not None:
            name = self.document.extension("KHR_texture_transform")
            found["extensions"] = {name: transform}
        return found

    def _sampler(self, picture: Picture) -> int:
        if picture.layout not in self._samplers:
            u, v = picture.wrap
            sampler = {
                "magFilter": _NEAREST if picture.nearest else _LINEAR,
                "minFilter": _NEAREST if picture.nearest else _MIPMAPS,
                "wrapS": _WRAPS[u],
                "wrapT": _WRAPS[v],
            }
            self._samplers[picture.layout] = self.document.add("samplers", sampler)
        return self._samplers[picture.layout]

    def _transform(self, owner: str, use: Use) -> dict[str, Any]:
        """offset, rotation and scale; v runs down in glTF."""
        (a, b, x), (c, d, y) = use.uv
        angle = math.atan2(c, a)
        cosine, sine = math.cos(angle), math.sin(angle)
        scale = math.hypot(a, c), d * cosine - b * sine
        if abs(b * cosine + d * sine) > _SHEAR * max(map(abs, (a, b, c, d))):
            self.world.notes.add(owner, "the shear of texture coordinates is left out")
        offset = x - sine * scale[1], 1 - cosine * scale[1] - y
        return {"offset": list(offset), "rotation": angle, "scale": list(scale)}


def _resized(values: NdArray, size: tuple[int, ...]) -> NdArray:
    """Resizes to (H, W), by the nearest texel."""
    rows, columns = (
        ((np.arange(n) + 0.5) * old / n).astype(int) for n, old in zip(size, values.shape)
    )
    return np.asarray(values[rows][:, columns])


def scaled(field: Field) -> tuple[Field, float]:
    """Field scaled so that its largest factor is 1, and that factor; for fields that may exceed
    1."""
    use = field.use
    folded = use is not None and use.offset == 0 and use.scale > 0
    value = np.multiply(field.value, use.scale if folded and use else 1.0)
    most = float(value.max())
    if most == 0:
        return field, 0.0
    return Field(value / most, replace(use, scale=1.0) if folded and use else use), most
