"""Materials and textures of a model's file, in nvisii's terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .component import Component
from .lights import light
from .materials import material
from .models import Model
from .parameters import PARAMETERS
from .pictures import to_linear
from .textures import texture

Namer = Callable[[type[Component], str], str]


def textures_of(model: Model, named: Namer, made: list[texture]) -> dict[int, texture]:
    """The textures of a file by the number of their edit."""
    out = {}
    for index, name, message in model.of_kind("texture"):
        texels = _rgba(model.array(message.texels))
        linear = message.encoding != message.Encoding.Value("ENCODING_SRGB")
        out[index] = texture(named(texture, name), texels, linear)
        made.append(out[index])
    return out


def _rgba(texels: Any) -> Any:
    """(H, W, 4) uint8 or float32 of any texels; grey is repeated."""
    texels = texels[..., None] if texels.ndim == 2 else texels
    if texels.dtype == np.uint16:
        texels = texels.astype("f4") / np.float32(65535)
    one = np.array(255 if texels.dtype == np.uint8 else 1, texels.dtype)
    channels = texels.shape[2]
    color = texels[..., :3] if channels >= 3 else np.repeat(texels[..., :1], 3, axis=2)
    alpha = texels[..., -1:] if channels in (2, 4) else np.full((*texels.shape[:2], 1), one)
    joined = np.concatenate([color, alpha], axis=2)
    return joined if joined.dtype == np.uint8 else joined.astype("f4")


class Look:
    """A material, the components made for it, and the light that it gives off."""

    def __init__(self, message: Any, images: dict[int, texture], name: str) -> None:
        self.material = material.create(name)
        self.baked: list[texture] = []
        self.left_out: list[str] = []
        self._images = images
        self._light: light | None = None
        self._emission = message.emission if message.HasField("emission") else None
        strength = message.emission_strength
        self._strength = strength.value if message.HasField("emission_strength") else 1.0
        for parameter in PARAMETERS:
            if parameter.name in message.DESCRIPTOR.fields_by_name and message.HasField(
                parameter.name
            ):
                self._put(parameter.name, getattr(message, parameter.name))
        values = self.material._values
        values["specular"] *= 0.5  # of an index of 1.5, as reflectance 0.08
        if message.HasField("alpha_mode") and message.alpha_mode == 1:
            values["alpha"] = 1.0
            self.material.clear_alpha_texture()  # type: ignore[attr-defined]
        if message.HasField("normal_map"):
            self.material.set_normal_map_texture(self._image(message.normal_map))

    @classmethod
    def of(cls, made: material) -> Look:
        """Look of a material that exists already."""
        look = cls.__new__(cls)
        look.material, look.baked, look.left_out = made, [], []
        look._light, look._emission = None, None
        return look

    def light(self, named: Namer) -> light | None:
        """The light of surfaces that emit, by radiance; None: they do not."""
        emission = self._emission
        if self._light is None and emission is not None and self._strength > 0:
            color = _value(emission)
            if max(color) > 0:
                self._light = light.create(named(light, self.material._name))
                self._light.use_surface_area(True)
                self._light.set_intensity(self._strength * max(color))
                self._light.set_color([c / max(color) for c in color])
                if _is_bound(emission.texture):
                    self._light.set_color_texture(self._image(emission.texture))
        return self._light

    def _put(self, name: str, message: Any) -> None:
        factor = _value(message)
        self.material._values[name] = factor
        if not _is_bound(message.texture):
            return
        use = message.texture
        channel = 0 if isinstance(factor, tuple) else use.channel
        image = self._image(use)
        neutral = factor == 1.0 or factor == (1.0, 1.0, 1.0)
        if not (neutral and use.scale == 1 and use.offset == 0):
            image = self._scaled(image, name, use, factor)
        self.material._bind(name, image, channel)

    def _image(self, use: Any) -> texture:
        return self._images[use.texture.created_by_edit]

    def _scaled(self, image: texture, name: str, use: Any, factor: Any) -> texture:
        """(texel * scale + offset) * factor, as a picture of its own."""
        texels = to_linear(image).copy()
        count = 3 if isinstance(factor, tuple) else 4
        texels[..., :count] = (texels[..., :count] * use.scale + use.offset) * factor
        base = f"{self.material._name}/{name}"
        number, unique = 1, base
        while texture.get(unique) is not None:
            number += 1
            unique = f"{base}_{number}"
        self.baked.append(texture(unique, texels.astype("f4"), True))
        return self.baked[-1]


def _value(message: Any) -> Any:
    value = message.value
    return value if isinstance(value, float) else (value.x, value.y, value.z)


def _is_bound(use: Any) -> bool:
    return bool(use.texture.WhichOneof("target") == "created_by_edit")
