"""The JSON and the binary chunk of a GLB file, as they grow. Source: glTF 2.0, 3.6 and 4."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..._version import __version__
from ..._wire.arrays import NdArray, bytes_of
from ...errors import InvalidArgument

_COMPONENTS = {"|u1": 5121, "<u2": 5123, "<u4": 5125, "<f4": 5126}
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
VERTICES, INDICES = 34962, 34963  #: targets of buffer views
_LARGEST = 2**32 - 1  # bytes of a file


class Document:
    """A glTF document with one buffer. Bytes are kept until write()."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"Heliograph {__version__}"}
        }
        self._chunks: list[bytes | memoryview] = []
        self._size = 0

    def add(self, kind: str, thing: dict[str, Any]) -> int:
        """Puts an object into a list of the document; its index there."""
        listed = self.json.setdefault(kind, [])
        listed.append(thing)
        return len(listed) - 1

    def extension(self, name: str) -> str:
        """A name that the document then lists as used."""
        used = self.json.setdefault("extensionsUsed", [])
        if name not in used:
            used.append(name)
            used.sort()
        return name

    def view(self, data: bytes | memoryview, target: int | None = None) -> int:
        """A buffer view of its own, at a multiple of 4."""
        found: dict[str, Any] = {"buffer": 0, "byteOffset": self._size, "byteLength": len(data)}
        if target is not None:
            found["target"] = target
        self._put(data)
        return self.add("bufferViews", found)

    def _put(self, data: bytes | memoryview) -> None:
        padding = -len(data) % 4
        self._chunks += [data, bytes(padding)]
        self._size += len(data) + padding

    def accessor(self, values: NdArray, target: int | None = None, *, box: bool = False) -> int:
        """Elements (N,) or (N, width) as they are. box: with the smallest and the largest."""
        data = np.ascontiguousarray(values)
        width = 1 if data.ndim == 1 else int(np.prod(data.shape[1:]))
        found: dict[str, Any] = {
            "bufferView": self.view(bytes_of(data), target),
            "componentType": _COMPONENTS[data.dtype.str],
            "count": len(data),
            "type": _KINDS[width],
        }
        if box:
            rows = data.reshape(len(data), width)
            found["min"], found["max"] = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
        return self.add("accessors", found)

    def write(self, path: Path) -> None:
        """The file."""
        if self._size:
            self.json["buffers"] = [{"byteLength": self._size}]
        text = json.dumps(self.json, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        head = text.encode()
        head += b" " * (-len(head) % 4)
        total = 12 + 8 + len(head) + (8 + self._size if self._size else 0)
        if total > _LARGEST:
            raise InvalidArgument(
                f"{path}: {total} bytes; a GLB file has 4 GiB at most: export a .usdz, or a "
                "part of the scene",
                field="path",
            )
        with open(path, "wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, total))
            file.write(struct.pack("<I4s", len(head), b"JSON") + head)
            if self._size:
                file.write(struct.pack("<I4s", self._size, b"BIN\0"))
                file.writelines(self._chunks)
