"""Shading networks: sources of inputs. Needs pxr."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Sdf, UsdShade

from .._wire.arrays import NdArray
from .context import Context
from .model import Image, Look, Sampled

_WRAPS = {"repeat": "repeat", "clamp": "clamp", "mirror": "mirror", "useMetadata": "repeat"}
ENCODINGS = {"raw": "linear", "sRGB": "srgb"}  #: by names of colour spaces
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}


@dataclass(frozen=True)
class Output:
    """An output of a shader, which an input is connected to."""

    shader: Any
    name: str

    @property
    def kind(self) -> str:
        return str(self.shader.GetShaderId())


def fed(context: Context, shader: Any, name: str) -> Any:
    """A constant, an Output, or None: the input has neither. Through interfaces of graphs."""
    found = shader.GetInput(name)
    sources = UsdShade.Utils.GetValueProducingAttributes(found) if found else []
    if not sources:
        return None
    if UsdShade.Output.IsOutput(sources[0]):
        output = UsdShade.Output(sources[0])
        return Output(UsdShade.Shader(sources[0].GetPrim()), output.GetBaseName())
    if sources[0].GetNumTimeSamples() > 1:
        context.note(shader, f"{name} changes, and is taken as at one time")
    return context.value(sources[0])


def constant(context: Context, shader: Any, name: str, default: Any) -> Any:
    """The constant of an input, numbers as float or tuple; the default where it has none."""
    found = fed(context, shader, name)
    if isinstance(found, Output):
        context.note(shader, f"{name} is computed by {found.kind}: its default is taken")
        return default
    return default if found is None else plain(found)


def plain(value: Any) -> Any:
    """A float or tuple of floats of Gf's and numpy's; others as they are."""
    if isinstance(value, (bool, str, Sdf.AssetPath)):
        return value
    if np.ndim(value) == 0:
        return float(value)
    return tuple(float(x) for x in value)


class Textures:
    """UsdUVTexture nodes of one look as Sampled."""

    def __init__(self, context: Context, look: Look) -> None:
        self.context = context
        self.look = look

    def sampled(self, output: Output, linear: bool = False) -> Sampled | None:
        """Texture lookup of a UsdUVTexture; None: no texture, so its fallback is to be used
        (noted)."""
        shader = output.shader
        file = fed(self.context, shader, "file")
        image = None
        if isinstance(file, Sdf.AssetPath):
            encoding = "linear" if linear else self._encoding(shader)
            image = self.image(shader, file, encoding, self._wraps(shader))
        if image is None:
            return None
        uv, uv_set = self._coordinates(fed(self.context, shader, "st"), shader)
        scale = np.array(constant(self.context, shader, "scale", (1.0,) * 4))
        bias = np.array(constant(self.context, shader, "bias", (0.0,) * 4))
        fallback = constant(self.context, shader, "fallback", (0.0, 0.0, 0.0, 1.0))
        given = (image, uv, uv_set)
        if output.name in _CHANNELS:
            channel = _CHANNELS[output.name]
            return Sampled(
                *(image, 1.0, channel, float(scale[channel]), float(bias[channel])),
                *(uv, uv_set, fallback[channel]),
            )
        return self._colored(shader, given, (scale[:3], bias[:3]), fallback[:3])

    def _colored(
        self,
        shader: Any,
        given: tuple[Image, Any, int],
        affine: tuple[NdArray, NdArray],
        fallback: Any,
    ) -> Sampled:
        """texel scale + bias as (texel most + offset) factor, whose factor is at most 1."""
        image, uv, uv_set = given
        scale, bias = affine
        most = float(np.abs(scale).max()) or 1.0
        factor = scale / most
        with np.errstate(divide="ignore", invalid="ignore"):
            offsets = np.where(bias == 0, 0.0, bias / factor)
        if (factor < 0).any() or not np.isfinite(offsets).all() or np.ptp(offsets) > 1e-6:
            self.context.note(shader, "its scale and bias differ by channel; bias is left out")
            factor, offsets = np.abs(factor), np.zeros(3)
        return Sampled(image, plain(factor), 0, most, float(offsets[0]), uv, uv_set, fallback)

    def image(
        self, shader: Any, file: Any, encoding: str | None, wrap: tuple[str, str]
    ) -> Image | None:
        if "<UDIM>" in file.path:
            self.context.note(shader, f"UDIM textures are left out: {file.path}")
            return None
        found, why = self.context.files.found(file.path, file.resolvedPath)
        if found is None:
            self.context.note(shader, f"a texture is left out: {why}")
            return None
        return Image(found, encoding, wrap)

    def _encoding(self, shader: Any) -> str | None:
        space = constant(self.context, shader, "sourceColorSpace", "auto")
        return ENCODINGS.get(str(space))

    def _wraps(self, shader: Any) -> tuple[str, str]:
        modes = [str(constant(self.context, shader, f"wrap{x}", "useMetadata")) for x in "ST"]
        if "black" in modes:
            self.context.note(shader, "the wrap mode black is left out: clamp taken")
        return _WRAPS.get(modes[0], "clamp"), _WRAPS.get(modes[1], "clamp")

    def _coordinates(self, source: Any, shader: Any) -> tuple[Any, int]:
        """(2, 3) of the transforms before the primvar, None for none, and the primvar's uv_set."""
        matrix = np.eye(3)
        for _ in range(8):
            if not isinstance(source, Output) or source.kind != "UsdTransform2d":
                break
            matrix = matrix @ _transform2d(self.context, source.shader)
            source = fed(self.context, source.shader, "in")
        name = "st"
        if isinstance(source, Output) and source.kind.startswith("UsdPrimvarReader"):
            name = str(constant(self.context, source.shader, "varname", "st"))
        elif source is not None:
            self.context.note(shader, "its st comes from no UsdPrimvarReader: the primvar st taken")
        uv = None if np.array_equal(matrix, np.eye(3)) else tuple(map(tuple, matrix[:2]))
        return uv, self.uv_set(shader, name)

    def uv_set(self, shader: Any, name: str) -> int:
        """Index of a primvar among those that the look reads."""
        read = self.look.primvars
        if name not in read and len(read) == 2:
            self.context.note(shader, f"a material reads 2 primvars at most: {read[0]} for {name}")
            return 0
        if name not in read:
            read.append(name)
        return read.index(name)


def _transform2d(context: Context, shader: Any) -> NdArray:
    """(3, 3): scales, turns counter-clockwise, moves."""
    angle = np.radians(constant(context, shader, "rotation", 0.0))
    scale = constant(context, shader, "scale", (1.0, 1.0))
    move = constant(context, shader, "translation", (0.0, 0.0))
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, move[0]], [s, c, move[1]], [0, 0, 1]])
    return np.asarray(turn @ np.diag([*scale, 1.0]))
