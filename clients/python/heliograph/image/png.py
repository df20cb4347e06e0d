"""PNG files of 8 and 16 bits: Pillow does not write colour pictures of 16 bits."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument

_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # channels to grey, grey and alpha, RGB, RGBA
_UP = 2  # each byte less the one above it
_LEVEL = 6


def encode(pixels: NdArray) -> bytes:
    """The PNG file of (H, W) or (H, W, 2 to 4) uint8 or uint16 (PNG, third edition, W3C 2025).

    The same pixels give the same bytes for one version of zlib.
    """
    channels = 1 if pixels.ndim == 2 else pixels.shape[-1]
    if pixels.dtype not in (np.uint8, np.uint16) or channels not in _COLOR_TYPES:
        raise InvalidArgument(
            f"pixels: {pixels.dtype} of shape {pixels.shape}; needs (H, W) or (H, W, 2 to 4) "
            "uint8 or uint16",
            field="pixels",
        )
    height, width = pixels.shape[:2]
    big_endian = np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder(">"))
    lines = big_endian.view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, lines.shape[1] + 1), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = lines[0]
    np.subtract(lines[1:], lines[:-1], out=filtered[1:, 1:])
    bits = 8 * pixels.dtype.itemsize
    header = struct.pack(">IIBBBBB", width, height, bits, _COLOR_TYPES[channels], 0, 0, 0)
    data = zlib.compress(filtered.tobytes(), _LEVEL)
    chunks = ((b"IHDR", header), (b"IDAT", data), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, body) for kind, body in chunks)


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
