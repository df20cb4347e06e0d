"""PNG pictures of 16 bits a channel, colour ones too, which Pillow reads as 8 bits.

Format: Portable Network Graphics, third edition (W3C 2025), sections 5 and 9.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from ..._wire.arrays import NdArray
from .report import Malformed

_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}  # by colour type


def read_png(path: Path) -> NdArray:
    """(H, W) or (H, W, C), uint8 or uint16. Without palette and interlace."""
    try:
        data = path.read_bytes()
        if data[:8] != b"\x89PNG\r\n\x1a\n":
            raise ValueError("it does not begin as a PNG does")
        chunks = list(_chunks(data))
        header = next(body for kind, body in chunks if kind == b"IHDR")
        width, height, bits, color, _, _, interlace = struct.unpack(">IIBBBBB", header)
        if bits not in (8, 16) or color not in _CHANNELS or interlace:
            raise ValueError(f"bit depth {bits}, colour type {color}, interlace {interlace}")
        raw = zlib.decompress(b"".join(body for kind, body in chunks if kind == b"IDAT"))
        pixel = _CHANNELS[color] * bits // 8
        lines = np.frombuffer(raw, np.uint8).reshape(height, 1 + width * pixel)
    except (OSError, ValueError, StopIteration, struct.error, zlib.error) as error:
        raise Malformed(path, f"is no PNG that can be read ({error}): write it anew") from None
    plain = _unfiltered(lines, pixel)
    shape = (height, width, _CHANNELS[color]) if color else (height, width)
    kind = np.dtype(">u2") if bits == 16 else np.dtype(np.uint8)
    return plain.view(kind).reshape(shape).astype(kind.newbyteorder("="))


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    out, at = [], 8
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        (check,) = struct.unpack(">I", data[at + 8 + length : at + 12 + length])
        if zlib.crc32(kind + body) != check:
            raise ValueError(f"the checksum of {kind.decode('latin-1')} is wrong")
        out.append((kind, body))
        at += 12 + length
    return out


def _unfiltered(lines: NdArray, pixel: int) -> NdArray:
    """(H, bytes) of lines that begin with the kind of their filter (section 9.2)."""
    above = np.zeros(lines.shape[1] - 1, np.uint8)
    out = np.empty((len(lines), lines.shape[1] - 1), np.uint8)
    for row, line in zip(out, lines):
        kind, row[:] = line[0], line[1:]
        if kind == 1:
            row[:] = np.cumsum(row.reshape(-1, pixel), axis=0, dtype=np.uint8).ravel()
        elif kind == 2:
            row += above
        elif kind in (3, 4):
            row[:] = _sequential(row.tolist(), above.tolist(), pixel, int(kind))
        elif kind:
            raise ValueError(f"filter {kind}")
        above = row
    return out


def _sequential(row: list[int], above: list[int], pixel: int, kind: int) -> list[int]:
    """Undoes the filters that depend on bytes just decoded: 3 average, 4 Paeth."""
    for i in range(len(row)):
        left, corner = (row[i - pixel], above[i - pixel]) if i >= pixel else (0, 0)
        up = above[i]
        if kind == 3:
            guess = (left + up) // 2
        else:
            to_left, to_up = abs(up - corner), abs(left - corner)
            to_corner = abs(left + up - 2 * corner)
            if to_left <= to_up and to_left <= to_corner:
                guess = left
            else:
                guess = up if to_up <= to_corner else corner
        row[i] = (row[i] + guess) & 255
    return row
