"""Multi-part OpenEXR files of a frame. Used by Frame.save and the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._optional import openexr
from ..errors import InvalidArgument

if TYPE_CHECKING:
    from ..render.frame import Frame

_COLOR = "RGBA"
_VECTOR = "XYZW"


def write(path: Path, frame: Frame) -> None:
    """Writes one part per plane, named as the plane: linear data, zip-compressed. Each part's
    header has `unit`; the first one's also the manifest, the camera and the labels' id tables, as
    JSON."""
    exr = openexr()
    parts: list[Any] = []
    for name in frame.planes:
        data = frame[name]
        header: dict[str, Any] = {
            "compression": exr.ZIP_COMPRESSION,
            "type": exr.scanlineimage,
            "unit": frame.units[name],
        }
        if not parts:
            header["manifest"] = frame.manifest
            header["camera"] = json.dumps(frame.shot)
            header["categories"] = json.dumps(frame.categories)
            header["software"] = "heliograph"
        parts.append(exr.Part(header, _channels(name, data), name))
    if not parts:
        raise InvalidArgument("this frame has no planes to write", field="planes")
    exr.File(parts).write(str(path))


def _channels(plane: str, data: Any) -> dict[str, Any]:
    """Channel name to array. EXR has no 8-bit channels: they become 32-bit."""
    if data.dtype == np.uint8:
        data = data.astype(np.uint32)
    if data.ndim == 2:
        return {plane.partition(":")[0]: np.ascontiguousarray(data)}
    spatial = ("normal", "tangent", "position", "flow", "coordinates", "nocs", "uv", "barycentric")
    names = _VECTOR if any(word in plane for word in spatial) else _COLOR
    return {names[i]: np.ascontiguousarray(data[..., i]) for i in range(data.shape[2])}


def read_manifest(path: Path) -> str:
    """The manifest of a file that write() made."""
    exr = openexr()
    try:
        header = exr.File(str(path), header_only=True).header()
    except RuntimeError as error:
        raise InvalidArgument(f"{path} is no EXR file: {error}", field="frame") from None
    if "manifest" not in header:
        raise InvalidArgument(f"{path} carries no manifest", field="frame")
    return str(header["manifest"])
