"""Scene files: "HELIOSC1", then SceneChunk messages, each after its length (u32, little-endian).

Read and written by Client.load_scene and Scene.save; the messages are the daemon's.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from .._wire._proto import service_pb2 as service
from ..errors import InvalidArgument, NotFound

_MAGIC = b"HELIOSC1"
_LENGTH = struct.Struct("<I")
_HEADER_BYTES = 1 << 20
_LONGEST = 64 << 20


def write(path: str | os.PathLike[str], chunks: Iterable[service.SceneChunk]) -> None:
    """Writes a scene file. Names it only once it is complete. The same scene has the same bytes:
    maps are sorted."""
    final = Path(path)
    partial = final.with_name(final.name + ".partial")
    try:
        with open(partial, "wb") as file:
            file.write(_MAGIC)
            for chunk in _sorted(chunks):
                data = chunk.SerializeToString(deterministic=True)
                file.write(_LENGTH.pack(len(data)))
                file.write(data)
        os.replace(partial, final)
    finally:
        partial.unlink(missing_ok=True)


def _sorted(chunks: Iterable[service.SceneChunk]) -> Iterator[service.SceneChunk]:
    """Yields the chunks, with the maps of a header that comes in pieces sorted, too."""
    pieces = b""
    for chunk in chunks:
        if chunk.WhichOneof("part") == "header_chunk":
            pieces += chunk.header_chunk
            continue
        if pieces:
            yield from _header_chunks(service.SceneChunk.Header.FromString(pieces))
            pieces = b""
        yield chunk
    if pieces:
        yield from _header_chunks(service.SceneChunk.Header.FromString(pieces))


def read(path: str | os.PathLike[str], **fields: Any) -> Iterator[service.SceneChunk]:
    """The chunks for ImportScene, with these fields of the header set."""
    chunks = _read_chunks(path)
    pieces = b""
    for chunk in chunks:
        if chunk.WhichOneof("part") == "header_chunk":
            pieces += chunk.header_chunk
            continue
        header = service.SceneChunk.Header()
        if pieces:
            header.ParseFromString(pieces)
        elif chunk.WhichOneof("part") == "header":
            header = chunk.header
        else:
            raise InvalidArgument(f"{path}: has no header; it is not a scene file", field="path")
        header.MergeFrom(service.SceneChunk.Header(**fields))
        yield from _header_chunks(header)
        if pieces:
            yield chunk
        yield from chunks
        return
    if not pieces:
        raise InvalidArgument(f"{path}: ends before its header", field="path")
    header = service.SceneChunk.Header.FromString(pieces)
    header.MergeFrom(service.SceneChunk.Header(**fields))
    yield from _header_chunks(header)


def _header_chunks(header: service.SceneChunk.Header) -> Iterator[service.SceneChunk]:
    data = header.SerializeToString(deterministic=True)
    if len(data) <= _HEADER_BYTES:
        yield service.SceneChunk(header=header)
        return
    for start in range(0, len(data), _HEADER_BYTES):
        yield service.SceneChunk(header_chunk=data[start : start + _HEADER_BYTES])


def _read_chunks(path: str | os.PathLike[str]) -> Iterator[service.SceneChunk]:
    if not os.path.exists(path):
        raise NotFound(f"no file {os.fspath(path)}", field="path")
    with open(path, "rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise InvalidArgument(f"{path} is not a scene file", field="path")
        while True:
            prefix = file.read(_LENGTH.size)
            if not prefix:
                return
            length = _LENGTH.unpack(prefix)[0] if len(prefix) == _LENGTH.size else _LONGEST + 1
            data = file.read(length) if length <= _LONGEST else b""
            if len(data) != length:
                raise InvalidArgument(f"{path}: is cut off or damaged", field="path")
            yield service.SceneChunk.FromString(data)
