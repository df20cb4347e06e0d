"""Vertices of PLY files (Turk 1994): ascii and little-endian. Used by bop_models.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .report import Malformed

_TYPES = {
    **dict.fromkeys(("char", "int8"), "<i1"),
    **dict.fromkeys(("uchar", "uint8"), "<u1"),
    **dict.fromkeys(("short", "int16"), "<i2"),
    **dict.fromkeys(("ushort", "uint16"), "<u2"),
    **dict.fromkeys(("int", "int32"), "<i4"),
    **dict.fromkeys(("uint", "uint32"), "<u4"),
    **dict.fromkeys(("float", "float32"), "<f4"),
    **dict.fromkeys(("double", "float64"), "<f8"),
}


def vertices(path: Path) -> NdArray:
    """(N, 3) float64, in the file's unit."""
    try:
        with open(path, "rb") as file:
            return _read(path, file)
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise Malformed(path, f"is no PLY model that can be read ({error}): write it") from None


def _read(path: Path, file: Any) -> NdArray:
    if file.readline().strip() != b"ply":
        raise ValueError("it does not begin with ply")
    form, element, count = "", "", 0
    properties: list[tuple[str, str]] = []
    first = ""
    while (words := file.readline().decode("ascii").split()) != ["end_header"]:
        if not words:
            raise ValueError("its header does not end")
        if words[0] == "format":
            form = words[1]
        elif words[0] == "element":
            element = words[1]
            first = first or element
            count = int(words[2]) if element == "vertex" else count
        elif words[0] == "property" and element == "vertex":
            properties.append((words[2], _TYPES[words[1]]))
    if first != "vertex":
        raise ValueError("its vertices do not come first")
    kind = np.dtype(properties)
    if form == "ascii":
        lines = [file.readline().split() for _ in range(count)]
        rows = np.array([tuple(map(float, line)) for line in lines])
        table = {name: rows[:, i] for i, (name, _) in enumerate(properties)}
    elif form == "binary_little_endian":
        data = np.frombuffer(file.read(count * kind.itemsize), kind, count)
        table = {name: data[name] for name, _ in properties}
    else:
        raise ValueError(f"format {form!r} is neither ascii nor binary_little_endian")
    return np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
