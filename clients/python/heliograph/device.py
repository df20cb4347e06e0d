"""DeviceArray: a plane in a GPU's memory, as the libraries that compute there take it."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ._cuda import Mapping

_CUDA = 2  # kDLCUDA
_CODES = {"i": 0, "u": 1, "f": 2}  # kDLInt, kDLUInt, kDLFloat


class DeviceArray:
    """(H, W) or (H, W, C) numbers of a frame that stayed on the GPU that rendered it.

    Without a copy: `.torch()`, `cupy.asarray(x)`, anything that reads `__cuda_array_interface__`,
    `from_dlpack(x)`. They keep it alive, and while it is alive the daemon does not write there. The
    numbers are there already: no stream need be waited for. They are for reading; what is written
    there is seen by everybody who has this plane, and by nobody else.
    shape, dtype (numpy's), nbytes, device (the GPU's number in this process), pointer.
    """

    def __init__(
        self, lease: DeviceLease, offset: int, dtype: np.dtype[Any], shape: Sequence[int]
    ) -> None:
        self._lease = lease
        self.shape = tuple(shape)
        self.dtype = dtype
        self.nbytes = math.prod(shape) * dtype.itemsize
        self.pointer = lease.mapping.address + offset
        self.device = lease.mapping.device.number

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self.pointer, False),  # PyTorch takes none that is read-only
            "strides": None,
            "stream": None,
            "version": 3,
        }

    def __dlpack_device__(self) -> tuple[int, int]:
        return _CUDA, self.device

    def __dlpack__(self, **_: Any) -> Any:
        """A capsule; whatever stream the consumer names may read at once."""
        return _export(self)

    def torch(self) -> Any:
        """A torch.Tensor on the GPU, of the same memory."""
        import torch

        return torch.as_tensor(self, device=f"cuda:{self.device}")

    def numpy(self) -> np.ndarray[Any, np.dtype[Any]]:
        """A copy on the host."""
        out = np.empty(self.shape, self.dtype)
        flat: Any = out.reshape(-1).view(np.uint8)
        self._lease.mapping.device.download(self.pointer, memoryview(flat))
        return out

    def __repr__(self) -> str:
        return f"<DeviceArray {self.shape} {self.dtype} on GPU {self.device}>"


class DeviceLease:
    """One use of a buffer; ends when nothing refers to it."""

    def __init__(self, mapping: Mapping) -> None:
        self.mapping = mapping


# ---------------------------------------------------------------- DLPack, version 0


class _Tensor(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_void_p),
        ("device_type", ctypes.c_int32),
        ("device_id", ctypes.c_int32),
        ("ndim", ctypes.c_int32),
        ("code", ctypes.c_uint8),
        ("bits", ctypes.c_uint8),
        ("lanes", ctypes.c_uint16),
        ("shape", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("byte_offset", ctypes.c_uint64),
        ("manager_ctx", ctypes.c_void_p),
        ("deleter", ctypes.c_void_p),
    )


_NAME = b"dltensor"
_exported: dict[int, tuple[DeviceArray, Any, Any]] = {}  # by where the structure lies
_api = ctypes.pythonapi


def _export(array: DeviceArray) -> Any:
    shape = (ctypes.c_int64 * len(array.shape))(*array.shape)
    tensor = _Tensor(
        array.pointer,
        *(_CUDA, array.device, len(array.shape)),
        *(_CODES[array.dtype.kind], 8 * array.dtype.itemsize, 1),
        ctypes.addressof(shape),
        deleter=ctypes.cast(_forget, ctypes.c_void_p),
    )
    where = ctypes.addressof(tensor)
    _exported[where] = array, tensor, shape
    return _new_capsule(where, _NAME, ctypes.cast(_end_capsule, ctypes.c_void_p))


def _consumer_is_done(where: int) -> None:
    _exported.pop(where, None)


def _capsule_ends(capsule: int) -> None:
    """Nobody took it: one that was taken has another name."""
    if _is_valid(capsule, _NAME):
        _exported.pop(_pointer_of(capsule, _NAME), None)


_forget = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(_consumer_is_done)
_end_capsule = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(_capsule_ends)
_new_capsule = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p
)(("PyCapsule_New", _api))
_is_valid = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p)(
    ("PyCapsule_IsValid", _api)
)
_pointer_of = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", _api)
)
