"""Frames out of their parts. Used by whatever asks for frames."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from .._wire._proto import render_pb2 as render_pb
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, bytes_of, dtype_of
from .._wire.device import DeviceArray
from .._wire.shared import SharedFrames
from ..errors import Internal
from ._chunk_span import chunk_span
from .frame import Frame, Rendered
from .worlds import WorldFrame

_NO_BYTES = memoryview(b"")


class Assembly:
    """Puts frames together as their parts arrive. Pixels are copied once, into their array, or stay
    in a shared buffer. Arrays are read-only."""

    def __init__(self, count: int, shared: SharedFrames | None) -> None:
        self._count = count
        self.shared = shared
        self._final: dict[int, Rendered] = {}
        self._header: render_pb.FrameHeader | None = None
        self._arrays: list[NdArray | DeviceArray] = []
        self._bytes: list[memoryview] = []
        self._left = 0

    def add(self, data: bytes) -> render_pb.Progress | Rendered | None:
        """A serialised FramePart; gives back progress, or the frame that this part completed."""
        span = chunk_span(data)
        if span is not None:
            plane, offset, start, size = span
            self._bytes[plane][offset : offset + size] = memoryview(data)[start : start + size]
            self._left -= size
            return self._complete()
        return self.add_part(render_pb.FramePart.FromString(data))

    def add_part(self, part: render_pb.FramePart) -> render_pb.Progress | Rendered | None:
        """Takes a part that is a message, as add() takes one that is bytes."""
        kind = part.WhichOneof("part")
        if kind == "progress":
            return part.progress
        if kind == "header":
            self._begin(part.header)
        elif kind == "chunk":
            chunk = part.chunk
            if chunk.HasField("buffer"):
                self._take_shared(chunk)
            else:
                end = chunk.offset + len(chunk.chunk)
                self._bytes[chunk.plane][chunk.offset : end] = chunk.chunk
                self._left -= len(chunk.chunk)
        return self._complete()

    def _begin(self, header: render_pb.FrameHeader) -> None:
        self._header = header
        self._arrays, self._bytes, self._left = [], [], 0
        picture: tuple[int, ...] = (header.height, header.width)
        if header.HasField("worlds"):
            picture = tuple(header.k.shape[:2]) + picture
        for plane in header.planes:
            shape = picture if plane.channels == 1 else (*picture, plane.channels)
            dtype = dtype_of(plane.dtype)
            if math.prod(shape) * dtype.itemsize != plane.size:
                raise Internal(f"plane {plane.name}: {plane.size} bytes do not fill {shape}")
            if plane.HasField("buffer"):
                self._arrays.append(self._in_buffer(plane.buffer, plane.size, dtype, shape))
                self._bytes.append(_NO_BYTES)
                continue
            array = np.empty(shape, dtype=dtype)
            self._arrays.append(array)
            self._bytes.append(bytes_of(array))
            self._left += plane.size

    def _take_shared(self, chunk: render_pb.PlaneChunk) -> None:
        old = self._arrays[chunk.plane]
        self._arrays[chunk.plane] = self._in_buffer(chunk.buffer, old.nbytes, old.dtype, old.shape)
        self._left -= old.nbytes

    def _in_buffer(
        self, place: types.BufferRef, size: int, dtype: np.dtype[Any], shape: tuple[int, ...]
    ) -> NdArray | DeviceArray:
        if self.shared is None:
            raise Internal("the daemon sent a shared buffer, which was not asked for")
        if place.size != size:
            raise Internal(f"the {place.size} bytes of a shared buffer do not fill {shape}")
        return self.shared.plane(place, dtype, shape)

    def _complete(self) -> Rendered | None:
        if self._left or self._header is None:
            return None
        kind = WorldFrame if self._header.HasField("worlds") else Frame
        frame: Rendered = kind(self._header, self._arrays)
        if self._header.final:
            self._final[self._header.frame] = frame
        self._header = None
        return frame

    def frames(self) -> list[Any]:
        """The final ones, in the order of the cameras."""
        if len(self._final) != self._count:
            raise Internal(f"{len(self._final)} of {self._count} frames arrived")
        return [self._final[i] for i in range(self._count)]


def frames_of(
    parts: Iterable[render_pb.FramePart], count: int, shared: SharedFrames | None
) -> list[Any]:
    """The frames of an answer that is here."""
    assembly = Assembly(count, shared)
    for part in parts:
        assembly.add_part(part)
    return assembly.frames()
