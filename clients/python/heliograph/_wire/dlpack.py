"""DLPack capsules. Their deleter is in C (native/dlpack.c), in a library beside heliographd: a
consumer may let go in any thread, without Python's lock, and when Python has ended. Used by
device.py."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any

from .launch import find_beside

LIBRARY = "heliograph-dlpack.so"


class Tensor(ctypes.Structure):
    """DLTensor."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("device_type", ctypes.c_int32),
        ("device_id", ctypes.c_int32),
        ("ndim", ctypes.c_int32),
        ("code", ctypes.c_uint8),
        ("bits", ctypes.c_uint8),
        ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.c_void_p),
        ("byte_offset", ctypes.c_uint64),
    )


def is_here() -> bool:
    """True if this client has the native library. BufferError: it does not load."""
    return _function() is not None


def capsule(owner: object, tensor: Tensor) -> Any:
    """A capsule of version 0 of this memory; it keeps `owner` alive until the consumer is done.
    BufferError without the library."""
    function = _function()
    if function is None:
        folder = Path(__file__).resolve().parents[1] / "_bin"
        raise BufferError(
            f"no {LIBRARY} beside heliographd, without which there is no DLPack here: take it from "
            f"a bundle or a build of heliographd, and copy it to {folder} or set HELIOGRAPHD to "
            "the daemon beside it; torch() and readers of __cuda_array_interface__ need no library"
        )
    return function(owner, ctypes.byref(tensor))


@functools.cache
def _function() -> Any:
    path = find_beside(LIBRARY)
    if path is None:
        return None
    try:
        function = ctypes.PyDLL(str(path)).heliograph_dlpack_capsule  # keeps Python's lock
    except (OSError, AttributeError) as error:
        raise BufferError(f"{path} does not load here: {error}") from None
    function.argtypes = ctypes.py_object, ctypes.POINTER(Tensor)
    function.restype = ctypes.py_object
    return function
