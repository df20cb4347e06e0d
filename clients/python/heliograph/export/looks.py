"""Materials as their parameters: constants, and textures that drive them. Used by the writers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire.arrays import NdArray
from .world import World, key_of

MAPS = ("normal_map", "bump_map", "clearcoat_normal_map")
_SRGB_KNEE = 0.04045
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Use:
    """Lookup of a texture: (texel[channel] scale + offset), at uv (2, 3) times (u, v, 1)."""

    texture: int
    channel: int = 0
    scale: float = 1.0
    offset: float = 0.0
    uv: tuple[tuple[float, ...], ...] = _IDENTITY
    uv_set: int = 0

    @property
    def is_turned(self) -> bool:
        """True if its coordinates are not those of the mesh."""
        return self.uv != _IDENTITY


@dataclass(frozen=True)
class Field:
    """A parameter: a number or (3,) colour, times a texture's value, if any."""

    value: Any
    use: Use | None = None

    @property
    def is_zero(self) -> bool:
        return not np.any(self.value)


@dataclass(frozen=True)
class Look:
    """A material. fields: all its parameters. maps: the normal and height maps that it has."""

    name: str
    fields: dict[str, Field]
    maps: dict[str, Use]
    alpha_mode: str = "opaque"
    alpha_cutoff: float = 0.5
    two_sided_emission: bool = False
    unlit: bool = False
    thin_walled: bool = False
    priority: int = 0

    def __getitem__(self, name: str) -> Field:
        return self.fields[name]

    def number(self, name: str) -> float:
        return float(self.fields[name].value)

    def with_fields(self, **fields: Field) -> Look:
        return replace(self, fields={**self.fields, **fields})

    @property
    def emits(self) -> bool:
        return not (self["emission"].is_zero or self["emission_strength"].is_zero)


def look_of(world: World, name: str, message: pb.Material) -> Look:
    """Look of a Material message, which holds only parameters that are not the default."""
    fields, maps = {}, {}
    for field in pb.Material.DESCRIPTOR.fields:
        kind = field.message_type.name if field.message_type is not None else ""
        if kind in ("ScalarParameter", "ColorParameter"):
            fields[field.name] = _field(world, message, field.name)
        elif kind == "TextureUse" and message.HasField(field.name):
            maps[field.name] = use_of(world, getattr(message, field.name))
    mode = pb.Material.AlphaMode.Name(message.alpha_mode or 1)
    return Look(
        name,
        fields,
        {name: use for name, use in maps.items() if use is not None},
        mode[len("ALPHA_MODE_") :].lower(),
        message.alpha_cutoff if message.HasField("alpha_cutoff") else 0.5,
        *(message.two_sided_emission, message.unlit, message.thin_walled, message.priority),
    )


def _field(world: World, message: pb.Material, name: str) -> Field:
    parameter = getattr(message, name)
    given = parameter if parameter.HasField("value") else getattr(world.default_material, name)
    rgb: Any = given.value
    value = rgb if isinstance(parameter, pb.ScalarParameter) else (rgb.x, rgb.y, rgb.z)
    return Field(value, use_of(world, parameter.texture) if parameter.HasField("texture") else None)


def use_of(world: World, message: pb.TextureUse) -> Use | None:
    """Lookup of a TextureUse; None: it has no texture."""
    texture = key_of(message.texture)
    if texture is None:
        return None
    given = world.optional(message, "uv_transform")
    return Use(
        texture,
        message.channel,
        message.scale if message.HasField("scale") else 1.0,
        message.offset,
        _IDENTITY if given is None else tuple(tuple(row) for row in given.tolist()),
        message.uv_set,
    )


@dataclass(frozen=True)
class Picture:
    """A texture: (H, W, C) texels as they are, and how they are read."""

    name: str
    texels: NdArray
    srgb: bool
    wrap: tuple[str, str]
    nearest: bool

    @property
    def layout(self) -> tuple[Any, ...]:
        """Sampling apart from the coordinates: wrap, nearest."""
        return self.wrap, self.nearest

    @property
    def has_levels(self) -> bool:
        """8 or 16 bits, in [0, 1]."""
        return self.texels.dtype.kind == "u"

    def has_alpha(self) -> bool:
        return self.texels.shape[2] in (2, 4)

    def levels(self) -> NdArray:
        """(H, W, C) float32, not decoded."""
        if not self.has_levels:
            return np.asarray(self.texels, dtype="f4")
        return self.texels.astype("f4") / np.iinfo(self.texels.dtype).max

    def rgba(self) -> NdArray:
        """(H, W, 4) float32, linear: grey fills RGB, a missing alpha is 1."""
        levels = self.levels()
        channels = levels.shape[2]
        out = np.ones((*levels.shape[:2], 4), "f4")
        out[..., :3] = levels[..., :1] if channels < 3 else levels[..., :3]
        if self.srgb:
            out[..., :3] = from_srgb(out[..., :3])
        if self.has_alpha():
            out[..., 3] = levels[..., -1]
        return out

    def values(self, use: Use, is_color: bool) -> NdArray:
        """Values (H, W) or (H, W, 3) that a use of the texture gives."""
        rgba = self.rgba()
        texels = rgba[..., :3] if is_color else rgba[..., use.channel]
        return texels * np.float32(use.scale) + np.float32(use.offset)


def picture_of(world: World, key: int) -> Picture:
    found = world.shared[key]
    message: pb.Texture = found.message
    texels = world.array(message.texels)
    texels = texels[..., None] if texels.ndim == 2 else texels
    encoding = message.encoding
    by_dtype = encoding == pb.Texture.ENCODING_UNSPECIFIED and texels.dtype == np.uint8
    wraps = [
        pb.Texture.Wrap.Name(wrap or 1)[len("WRAP_") :].lower()
        for wrap in (message.wrap_u, message.wrap_v)
    ]
    return Picture(
        found.name,
        texels,
        encoding == pb.Texture.ENCODING_SRGB or by_dtype,
        (wraps[0], wraps[1]),
        message.filter == pb.Texture.FILTER_NEAREST,
    )


def from_srgb(levels: NdArray) -> NdArray:
    """Linear, of IEC 61966-2-1."""
    curve = ((np.maximum(levels, 0) + 0.055) / 1.055) ** 2.4
    return np.where(levels <= _SRGB_KNEE, levels / 12.92, curve).astype("f4")


def to_srgb(linear: NdArray) -> NdArray:
    """IEC 61966-2-1, of linear values in [0, 1]."""
    curve = 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    return np.where(linear <= _SRGB_KNEE / 12.92, 12.92 * linear, curve).astype("f4")


def quantized(levels: NdArray, deep: bool) -> NdArray:
    """[0, 1] as 8 bits, or as 16."""
    dtype = np.uint16 if deep else np.uint8
    return np.asarray(np.rint(np.clip(levels, 0, 1) * np.iinfo(dtype).max), dtype)
