"""DeviceArray: a plane in a GPU's memory, as the libraries that compute there take it."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import dlpack
from .cuda import Device, Mapping

_CUDA = 2  # kDLCUDA
_CODES = {"i": 0, "u": 1, "f": 2}  # kDLInt, kDLUInt, kDLFloat


class DeviceArray:
    """(H, W) or (H, W, C) numbers of a frame that stayed on the GPU that rendered it.

    Without a copy: `.torch()`, `cupy.asarray(x)`, anything that reads `__cuda_array_interface__`,
    `from_dlpack(x)`. They keep it alive, and while it is alive the daemon does not write there. The
    numbers are there already: no stream need be waited for. They are for reading; a write there is
    seen by all holders of this plane, and by nobody else.
    shape, dtype (numpy's), nbytes, device (the GPU's number in this process), pointer.
    """

    def __init__(
        self, lease: DeviceLease, offset: int, dtype: np.dtype[Any], shape: Sequence[int]
    ) -> None:
        self._lease = lease
        self.shape = tuple(shape)
        self.dtype = dtype
        self.nbytes = math.prod(shape) * dtype.itemsize
        self._address = lease.mapping.address + offset
        self.device = lease.mapping.device.number

    @property
    def pointer(self) -> int:
        """Address in the GPU's memory."""
        self._lease.show()
        return self._address

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

    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """A capsule of version 0, whatever is the newest that the consumer takes; whatever stream
        it names may read at once. BufferError: a copy or another device is asked for, or this
        client has no heliograph-dlpack.so.
        """
        here = self.__dlpack_device__()
        if dl_device is not None and tuple(dl_device) != here:
            raise BufferError(
                f"lies on the DLPack device {here} and cannot be exported to {tuple(dl_device)}: "
                ".numpy() is a copy on the host"
            )
        if copy:
            raise BufferError("is exported without a copy only: copy the consumer's array")
        tensor = dlpack.Tensor(
            self.pointer,
            *(*here, len(self.shape)),
            *(_CODES[self.dtype.kind], 8 * self.dtype.itemsize, 1),
            (ctypes.c_int64 * len(self.shape))(*self.shape),
        )
        return dlpack.capsule(self._lease, tensor)

    def torch(self) -> Any:
        """A torch.Tensor on the GPU, of the same memory: through DLPack, or in a client without
        heliograph-dlpack.so through the array interface."""
        import torch

        if dlpack.is_here():
            return torch.from_dlpack(self.__dlpack__())  # any stream may read it: none is looked up
        return torch.as_tensor(self, device=f"cuda:{self.device}")

    def numpy(self) -> np.ndarray[Any, np.dtype[Any]]:
        """A copy on the host."""
        out = np.empty(self.shape, self.dtype)
        flat: Any = out.reshape(-1).view(np.uint8)
        self._lease.mapping.device.download(self._address, memoryview(flat))
        return out

    def __repr__(self) -> str:
        return f"<DeviceArray {self.shape} {self.dtype} on GPU {self.device}>"


class DeviceLease:
    """Lease of a buffer; ends when nothing refers to it."""

    def __init__(self, mapping: Mapping) -> None:
        self.mapping = mapping
        self.readers: list[Device] = []  # GPUs that may read it for a while after that

    def show(self) -> None:
        """Notes that the address was given out: this GPU may read there for a while after the
        lease."""
        if not self.readers:
            self.readers.append(self.mapping.device)
