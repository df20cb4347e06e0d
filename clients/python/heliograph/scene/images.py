"""Pictures as textures and domes. Used by edit.py."""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, checked, inline
from ..errors import InvalidArgument, warn_of_file
from ..values.checks import color_of, number_of, refuse_unknown, text_of
from .assets import Source, decode_bundle

if TYPE_CHECKING:
    from ..client.edit import Edits


class DomeOptions(TypedDict, total=False):
    """Options of Edits.dome besides the picture; None: reset to its default."""

    color: Any  #: (3,) or a number, W sr^-1 m^-2; multiplies an image
    intensity: float | None  #: a factor
    rotation: Any  #: radians about +Z, or (3, 3) world_from_dome
    camera_visible: bool | None  #: False: camera rays see black
    light_group: str | None  #: as of an entity


def dome_message(given: DomeOptions) -> pb.Dome:
    """The Dome of some DomeOptions."""
    refuse_unknown(given, DomeOptions, "the dome")
    out = pb.Dome(clear=[name for name, value in given.items() if value is None])
    if given.get("color") is not None:
        out.color.CopyFrom(color_of(given["color"], "color"))
    if given.get("intensity") is not None:
        out.intensity = number_of(given["intensity"], "intensity")
    if given.get("rotation") is not None:
        out.rotation.CopyFrom(inline(rotation_of(given["rotation"])))
    if given.get("camera_visible") is not None:
        out.camera_visible = bool(given["camera_visible"])
    if given.get("light_group") is not None:
        out.light_group = text_of(given["light_group"], "light_group")
    return out


class Sampler(NamedTuple):
    """Sampling of a texture; None: unchanged, or the default of a new one."""

    encoding: str | None
    wrap: str | tuple[str, str] | None
    filter: str | None


def texture_message(edits: Edits, image: Any, sampler: Sampler, layer: str) -> pb.Texture:
    """The Texture of a file or an array (None: texels stay)."""
    out = pb.Texture()
    encoding = sampler.encoding
    if image is None:
        refuse_layer(layer)
    else:
        texels, found = texels_of(edits, image, layer)
        out.texels.CopyFrom(texels)
        encoding = encoding or found or None
    if encoding is not None:
        out.encoding = choice(pb.Texture.Encoding, "ENCODING", encoding)
    if sampler.wrap is not None:
        both = (sampler.wrap, sampler.wrap) if isinstance(sampler.wrap, str) else sampler.wrap
        if len(both) != 2:
            raise InvalidArgument(f"wrap: one, or one each for u and v, not {both}", field="wrap")
        out.wrap_u, out.wrap_v = (choice(pb.Texture.Wrap, "WRAP", one) for one in both)
    if sampler.filter is not None:
        out.filter = choice(pb.Texture.Filter, "FILTER", sampler.filter)
    return out


def dome_texture(edits: Edits, image: Any, layer: str) -> tuple[str, pb.Texture]:
    """A texture and its name, with a hash of its content: the same dome is the same object."""
    texels, encoding = texels_of(edits, image, layer)
    digest = hashlib.sha256(texels.SerializeToString()).hexdigest()[:12]
    stem = Path(image).stem if isinstance(image, (str, os.PathLike)) else "array"
    message = pb.Texture(texels=texels, wrap_v=pb.Texture.WRAP_CLAMP)
    message.encoding = choice(pb.Texture.Encoding, "ENCODING", encoding or "linear")
    return f"dome/{stem}-{digest}", message


_ENCODINGS: dict[int, str] = {
    pb.Texture.ENCODING_UNSPECIFIED: "",
    pb.Texture.ENCODING_LINEAR: "linear",
    pb.Texture.ENCODING_SRGB: "srgb",
}


def texels_of(edits: Edits, image: Any, layer: str) -> tuple[types.Array, str]:
    """The texels of a file or an array, and their encoding ("": by dtype)."""
    if isinstance(image, (str, os.PathLike)):
        info = decode_bundle(edits.scene.client, Source(image, layer=text_of(layer, "layer")))
        warn_of_file(image, info.warnings)
        if not info.HasField("texels"):
            raise InvalidArgument(f"{image} is no picture", field="image")
        edits.note_decoding(info.texels.blob)
        return info.texels, _ENCODINGS[info.encoding]
    refuse_layer(layer)
    return edits.asset(_checked_texels(image)), ""


def refuse_layer(layer: str) -> None:
    """Refuses layer= where there is no file. InvalidArgument."""
    if layer:
        raise InvalidArgument("layer: is of a picture's file; select the array's", field="layer")


#: Mode that a PIL image of each mode is converted to, except modes whose numbers are no colours.
_PIL_MODES = {"1": "L", "L": "L", "La": "LA", "LA": "LA"}
_PIL_MODES |= dict.fromkeys(("PA", "RGBa", "RGBA"), "RGBA")
_PIL_MODES |= dict.fromkeys(("RGB", "RGBX", "P", "CMYK", "YCbCr", "HSV"), "RGB")


def is_pil(image: Any) -> bool:
    """True for a PIL image, which is known without loading PIL."""
    return isinstance(getattr(image, "mode", None), str) and hasattr(image, "convert")


def array_of(image: Any) -> NdArray:
    """An array, or the texels of a PIL image: u8 (H, W) or (H, W, C), u16 for 16 bits."""
    if not is_pil(image):
        return np.asarray(image)
    mode: str = image.mode
    if mode.startswith("I;16"):
        return np.asarray(image).astype("<u2")
    if mode not in _PIL_MODES:
        raise InvalidArgument(
            f"image: the numbers of a PIL image of mode {mode!r} are no colours that can be shown; "
            "give numpy.asarray(image) as u8, u16 or f32 if they are, or an image of mode RGB",
            field="image",
        )
    wanted = _PIL_MODES[mode]
    if "transparency" in image.info and wanted in ("L", "RGB"):
        wanted += "A"
    return np.asarray(image if mode == wanted else image.convert(wanted))


def _checked_texels(image: Any) -> NdArray:
    texels = array_of(image)
    texels = texels.astype(texels.dtype.newbyteorder("="), copy=False)
    if texels.dtype not in (np.uint8, np.uint16, np.float16, np.float32):
        if texels.dtype.kind != "f":
            raise InvalidArgument(
                f"image: texels are u8, u16, f16 or f32, not {texels.dtype}; convert them",
                field="image",
            )
        texels = texels.astype("<f4")
    shaped = texels.ndim == 2 or (texels.ndim == 3 and 1 <= texels.shape[2] <= 4)
    if not shaped or 0 in texels.shape:
        raise InvalidArgument(
            f"image: needs shape (H, W) or (H, W, 1..4), has {texels.shape}", field="image"
        )
    if texels.dtype.kind == "f" and not np.isfinite(texels).all():
        raise InvalidArgument("image: every texel must be finite", field="image")
    return np.ascontiguousarray(texels)


def choice(enum: Any, prefix: str, value: str) -> Any:
    names = [name[len(prefix) + 1 :].lower() for name in enum.keys()[1:]]
    if value not in names:
        field = prefix.lower()
        raise InvalidArgument(f"{field}: one of {', '.join(names)}, not {value!r}", field=field)
    return enum.Value(f"{prefix}_{value.upper()}")


def rotation_of(rotation: Any) -> NdArray:
    """(3, 3) float32 of an angle about +Z, or of a matrix."""
    if np.ndim(rotation) == 0:
        angle = number_of(rotation, "rotation")
        c, s = math.cos(angle), math.sin(angle)
        rotation = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return checked(rotation, "rotation", "<f4", (3, 3))
