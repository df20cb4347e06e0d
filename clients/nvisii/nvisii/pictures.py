"""Texels of textures: reads files, mixes, samples. Writes rendered pictures."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from heliograph._optional import openexr
from heliograph.image.tonemap import encode_srgb

from .checks import as_runtime_error

if TYPE_CHECKING:
    from .textures import texture

_LUMINANCE_EXPONENT = 128  # RGBE: value = mantissa / 256 * 2^(exponent - 128)


def read_picture(path: str | os.PathLike[str]) -> Any:
    """(H, W, 4), row 0 at the top: uint8, or float32 of .hdr, .exr and other files of floats."""
    path = os.fspath(path)
    if not os.path.isfile(path):
        raise RuntimeError(f"there is no file {path!r}")
    try:
        if path.lower().endswith((".hdr", ".pic")):
            return _opaque(read_hdr(path))
        if path.lower().endswith(".exr"):
            return _opaque(_read_exr(path))
        from PIL import Image

        with Image.open(path) as picture:
            return _texels(picture)
    except (OSError, ValueError, IndexError, SyntaxError) as error:
        raise RuntimeError(f"{path} is no picture that can be read: {error}") from None


def _texels(picture: Any) -> Any:
    """Texels of a PIL image. convert() would cut off grey of 16 bits ("I") and of floats ("F")."""
    if picture.mode[0] not in "IF":
        return np.array(picture.convert("RGBA"))
    gray = np.asarray(picture, dtype="f4")[..., None].repeat(3, axis=2)
    return _opaque(gray) if picture.mode == "F" else as_bytes(_opaque(gray / np.float32(65535)))


def _opaque(rgb: Any) -> Any:
    if rgb.shape[2] == 4:
        return np.ascontiguousarray(rgb, dtype="f4")
    return np.concatenate([rgb, np.ones((*rgb.shape[:2], 1))], axis=2).astype("f4")


def _open_exr() -> Any:
    with as_runtime_error():
        return openexr()


def _read_exr(path: str) -> Any:
    with _open_exr().File(path) as file:
        channels = file.channels()
        for name in ("RGBA", "RGB"):
            if name in channels:
                return np.asarray(channels[name].pixels, dtype="f4")
        names = [n for n in "RGBA" if n in channels]
        if names[:3] != ["R", "G", "B"]:
            raise RuntimeError(f"{path} has no channels R, G and B, but {', '.join(channels)}")
        return np.stack([channels[n].pixels for n in names], axis=-1).astype("f4")


# ---------------------------------------------------------------- Radiance's RGBE


def read_hdr(path: str) -> Any:
    """(H, W, 3) float32; Ward 1991, "Real Pixels"; flat or run-length encoded scanlines."""
    with open(path, "rb") as file:
        data = file.read()
    head, _, rest = data.partition(b"\n\n")
    if not head.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise ValueError("it is no Radiance picture")
    size, _, body = rest.partition(b"\n")
    words = size.split()
    if len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise ValueError(f"its orientation {size.decode(errors='replace')!r} is not -Y +X")
    height, width = int(words[1]), int(words[3])
    encoded = np.frombuffer(body, np.uint8)
    if 8 <= width < 32768 and encoded[:2].tolist() == [2, 2]:
        rgbe = _runs(body, width, height)
    else:
        rgbe = encoded[: 4 * width * height].reshape(height, width, 4)
    scale = np.ldexp(np.float32(1), rgbe[..., 3:].astype(int) - _LUMINANCE_EXPONENT - 8)
    return np.where(rgbe[..., 3:] > 0, (rgbe[..., :3] + 0.5) * scale, 0).astype("f4")


def _runs(body: bytes, width: int, height: int) -> Any:
    out, at = bytearray(), 0
    for y in range(1, height + 1):
        at += 4
        while len(out) < 4 * width * y:
            count = body[at]
            if count > 128:
                out += body[at + 1 : at + 2] * (count - 128)
                at += 2
            else:
                out += body[at + 1 : at + 1 + count]
                at += 1 + count
        if len(out) != 4 * width * y:
            raise ValueError(f"the runs of scanline {y} are too long")
    return np.frombuffer(out, np.uint8).reshape(height, 4, width).transpose(0, 2, 1)


def write_hdr(path: str, rgb: Any) -> None:
    """(H, W, 3) radiance to a flat RGBE file."""
    rgb = np.maximum(np.nan_to_num(rgb.astype("f4"), posinf=1e38), 0)
    mantissa, exponent = np.frexp(rgb.max(axis=2))
    scale = np.where(mantissa > 0, np.ldexp(np.float32(256), -exponent), 0)
    rgbe = np.empty((*rgb.shape[:2], 4), np.uint8)
    rgbe[..., :3] = np.minimum(rgb * scale[..., None], 255)
    rgbe[..., 3] = np.where(scale > 0, np.clip(exponent + _LUMINANCE_EXPONENT, 0, 255), 0)
    with open(path, "wb") as file:
        header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {len(rgb)} +X {rgb.shape[1]}\n"
        file.write(header.encode() + rgbe.tobytes())


# ---------------------------------------------------------------- what was rendered


def write_picture(path: str, rgba: Any) -> None:
    """(H, W, 4) float32, row 0 at the top, to .png (sRGB), .exr or .hdr (linear)."""
    ending = os.path.splitext(path)[1].lower()
    try:
        if ending == ".png":
            from PIL import Image

            image = np.nan_to_num(rgba, nan=0, posinf=1, neginf=0)
            image = np.concatenate([encode_srgb(image[..., :3]), np.clip(image[..., 3:], 0, 1)], 2)
            Image.fromarray((image * 255 + 0.5).astype(np.uint8)).save(path)
        elif ending == ".hdr":
            write_hdr(path, rgba[..., :3])
        elif ending == ".exr":
            exr = _open_exr()
            header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
            exr.File(header, {"RGBA": np.ascontiguousarray(rgba, dtype="f4")}).write(path)
        else:
            raise RuntimeError(f"{path}: the ending must be .png, .exr or .hdr")
    except OSError as error:
        raise RuntimeError(f"cannot write {path}: {error}") from None


# ---------------------------------------------------------------- texels


def as_bytes(values: Any) -> Any:
    """[0, 1] to uint8, rounded."""
    return np.rint(np.clip(np.nan_to_num(values), 0, 1) * 255).astype(np.uint8)


def to_linear(image: texture) -> Any:
    """Linear colours (H, W, 4) float32 of texels; alpha as it is."""
    texels = image._texels
    if image.is_hdr():
        return texels
    values = texels.astype("f4") / np.float32(255)
    if not image._linear:
        rgb = values[..., :3]
        values[..., :3] = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return values


def mixed(a: texture, b: texture, function: Callable[[Any, Any], Any]) -> Any:
    """Two textures, texel by texel; the smaller one is resampled."""
    first, second = to_linear(a), to_linear(b)
    height = max(first.shape[0], second.shape[0])
    width = max(first.shape[1], second.shape[1])
    return function(_resized(first, height, width), _resized(second, height, width))


def _resized(texels: Any, height: int, width: int) -> Any:
    if texels.shape[:2] == (height, width):
        return texels
    u = (np.arange(width) + 0.5) / width
    v = 1 - (np.arange(height) + 0.5) / height
    return sampled(texels, u[None, :], v[:, None]).astype("f4")


def sampled(texels: Any, u: Any, v: Any) -> Any:
    """Bilinear and repeated; v = 0 is the bottom."""
    height, width = texels.shape[:2]
    x = np.asarray(u, dtype=float) * width - 0.5
    y = (1 - np.asarray(v, dtype=float)) * height - 0.5
    x, y = np.broadcast_arrays(x, y)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    rows, columns = (top % height, (top + 1) % height), (left % width, (left + 1) % width)
    upper = texels[rows[0], columns[0]] * (1 - fx) + texels[rows[0], columns[1]] * fx
    lower = texels[rows[1], columns[0]] * (1 - fx) + texels[rows[1], columns[1]] * fx
    return upper * (1 - fy) + lower * fy


def hsv_of(rgba: Any, change: tuple[float, float, float]) -> Any:
    """Hue shifted by change[0] - 0.5 turns, saturation and value multiplied; Smith 1978."""
    rgb = np.maximum(rgba[..., :3], 0)
    value, low = rgb.max(axis=-1), rgb.min(axis=-1)
    chroma = value - low
    safe = np.where(chroma > 0, chroma, np.float32(1))
    r, g, b = (rgb[..., i] for i in range(3))
    sixths = np.where(value == r, (g - b) / safe, (b - r) / safe + 2)
    sixths = np.where((value == b) & (value != r) & (value != g), (r - g) / safe + 4, sixths)
    hue = sixths / 6 + np.float32(change[0] - 0.5)
    saturation = np.where(value > 0, chroma / np.where(value > 0, value, np.float32(1)), 0)
    saturation = np.clip(saturation * np.float32(change[1]), 0, 1)
    value = value * np.float32(change[2])
    out = np.empty_like(rgba, dtype="f4")
    for channel, place in enumerate((5 / 6, 3 / 6, 1 / 6)):
        turn = hue + np.float32(place)
        k = (turn - np.floor(turn)) * 6
        part = np.clip(np.minimum(k, 4 - k), 0, 1)
        out[..., channel] = value * (1 - saturation * part)
    out[..., 3] = rgba[..., 3]
    return out
