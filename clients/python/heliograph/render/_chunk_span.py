"""Span of the pixels in a serialised chunk of a frame. Used by call.py."""

from __future__ import annotations


def chunk_span(data: bytes) -> tuple[int, int, int, int] | None:
    """(plane, offset, start, size) of a FramePart whose part is a chunk of bytes, else None.

    The wire format of Protocol Buffers, read by hand so that the pixels are not copied twice:
    FramePart.chunk is field 2; PlaneChunk has plane 2, offset 3, chunk 4.
    """
    if data[:1] != b"\x12":
        return None
    _, at = _varint(data, 1)
    plane = offset = 0
    while at < len(data):
        tag, at = _varint(data, at)
        value, at = _varint(data, at)
        if tag == 0x22:
            return plane, offset, at, value
        if tag == 0x10:
            plane = value
        elif tag == 0x18:
            offset = value
        elif tag & 7:
            return None
    return None


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
