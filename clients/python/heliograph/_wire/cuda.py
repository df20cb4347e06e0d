"""A GPU's memory in this process: the CUDA driver, found at run time. Used by shared.py and
device.py for frames that stay on the GPU; nothing else needs a driver.

Functions and numbers are those of cuda.h; the driver is of CUDA 12.5 or newer.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import weakref
from ctypes import c_char, c_int, c_size_t, c_uint, c_ulonglong, c_void_p
from typing import Any

from ..errors import FailedPrecondition, Internal

LIBRARY = "libcuda.so.1"
_DESCRIPTOR = 1  # CU_MEM_HANDLE_TYPE_POSIX_FILE_DESCRIPTOR
_ON_DEVICE = 1  # CU_MEM_LOCATION_TYPE_DEVICE
_READ_WRITE = 3  # CU_MEM_ACCESS_FLAGS_PROT_READWRITE: devices have no other
_NO_TIMING = 2  # CU_EVENT_DISABLE_TIMING
_RELAXED = 2  # CU_STREAM_CAPTURE_MODE_RELAXED


class _Location(ctypes.Structure):
    _fields_ = (("kind", c_int), ("id", c_int))


class _Access(ctypes.Structure):
    _fields_ = (("location", _Location), ("flags", c_int))


_OUT = c_void_p  # where a result goes
_FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "cuInit": (c_uint,),
    "cuDeviceGetCount": (_OUT,),
    "cuDeviceGet": (_OUT, c_int),
    "cuDeviceGetUuid_v2": (_OUT, c_int),
    "cuDevicePrimaryCtxRetain": (_OUT, c_int),
    "cuCtxPushCurrent_v2": (c_void_p,),
    "cuCtxPopCurrent_v2": (_OUT,),
    "cuCtxSynchronize": (),
    "cuCtxRecordEvent": (c_void_p, c_void_p),
    "cuEventCreate": (_OUT, c_uint),
    "cuEventQuery": (c_void_p,),
    "cuEventDestroy_v2": (c_void_p,),
    "cuThreadExchangeStreamCaptureMode": (_OUT,),
    "cuMemImportFromShareableHandle": (_OUT, c_void_p, c_int),
    "cuMemRelease": (c_ulonglong,),
    "cuMemAddressReserve": (_OUT, c_size_t, c_size_t, c_ulonglong, c_ulonglong),
    "cuMemAddressFree": (c_ulonglong, c_size_t),
    "cuMemMap": (c_ulonglong, c_size_t, c_size_t, c_ulonglong, c_ulonglong),
    "cuMemUnmap": (c_ulonglong, c_size_t),
    "cuMemSetAccess": (c_ulonglong, c_size_t, c_void_p, c_size_t),
    "cuMemcpyDtoH_v2": (c_void_p, c_ulonglong, c_size_t),
    "cuMemcpyDtoDAsync_v2": (c_ulonglong, c_ulonglong, c_size_t, c_void_p),
    "cuStreamSynchronize": (c_void_p,),
}


class Driver:
    """libcuda, started. Belongs to the process that opened it. Thread: any."""

    def __init__(self) -> None:
        self._pid = os.getpid()
        self._devices: dict[bytes, Device] = {}
        self._functions: dict[str, Any] = {}
        try:
            library = ctypes.CDLL(LIBRARY)
        except OSError as error:
            raise _missing(f"finds no NVIDIA driver ({error})") from None
        for name, arguments in _FUNCTIONS.items():
            function = getattr(library, name, None)
            if function is None:
                raise _missing(f"has an NVIDIA driver without {name}, older than CUDA 12.5")
            function.argtypes = arguments
            function.restype = c_int
            self._functions[name] = function
        if self.result("cuInit", 0) != 0:
            raise _missing("has an NVIDIA driver that does not start (cuInit)")

    def result(self, name: str, *arguments: Any) -> int:
        """Calls a function of the driver and returns its code; 0: success."""
        return int(self._functions[name](*arguments))

    def call(self, name: str, *arguments: Any) -> None:
        """Calls a function of the driver; Internal unless it succeeds."""
        code = self.result(name, *arguments)
        if code != 0:
            raise Internal(f"device: {name} failed with CUDA error {code}")

    def device(self, uuid: bytes) -> Device:
        """The GPU with this UUID, whatever its number is here. FailedPrecondition."""
        if os.getpid() != self._pid:
            raise _missing("was forked after CUDA was used in its parent; use spawn")
        found = self._devices.get(uuid)
        if found is None:
            found = self._devices.setdefault(uuid, Device(self, uuid))
        return found

    def number_of(self, uuid: bytes) -> tuple[int, int]:
        """(number, handle) of a GPU as this process counts them."""
        count, handle, name = c_int(), c_int(), (c_char * 16)()
        self.call("cuDeviceGetCount", ctypes.byref(count))
        for number in range(count.value):
            self.call("cuDeviceGet", ctypes.byref(handle), number)
            self.call("cuDeviceGetUuid_v2", name, handle)
            if bytes(name) == uuid:
                return number, handle.value
        raise _missing(f"does not see the daemon's GPU {uuid.hex()}: look at CUDA_VISIBLE_DEVICES")


@functools.cache
def driver() -> Driver:
    """The one of this process. FailedPrecondition where there is none."""
    return Driver()


def _missing(what: str) -> FailedPrecondition:
    return FailedPrecondition(
        f"device: this process {what}; frames can stay only on a GPU of this machine that it can "
        "use: leave device= out",
        field="device",
    )


class Device:
    """A GPU, by its primary context: the one that PyTorch and CuPy use too."""

    def __init__(self, driver: Driver, uuid: bytes) -> None:
        self.driver = driver
        self.number, handle = driver.number_of(uuid)
        context = c_void_p()
        driver.call("cuDevicePrimaryCtxRetain", ctypes.byref(context), handle)
        self.context = context.value

    def current(self) -> _Current:
        """Makes the device this thread's within the block; calls there do not spoil the capture of
        a graph."""
        return _Current(self)

    def download(self, address: int, out: memoryview) -> None:
        """Copies to the host; waits for work on the default stream."""
        to = (c_char * out.nbytes).from_buffer(out)
        with self.current() as driver:
            driver.call("cuMemcpyDtoH_v2", to, address, out.nbytes)

    def copy(self, to: int, source: int, nbytes: int, stream: int | None) -> None:
        """Copies, on the GPU, bytes written by earlier work in a stream, or with None in any.
        Waits."""
        with self.current() as driver:
            if stream is None:
                driver.call("cuCtxSynchronize")
            driver.call("cuMemcpyDtoDAsync_v2", to, source, nbytes, stream)
            driver.call("cuStreamSynchronize", stream)


class _Current:
    """Context manager of Device.current()."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._mode, self._before = c_int(_RELAXED), c_void_p()

    def __enter__(self) -> Driver:
        driver = self._device.driver
        driver.call("cuCtxPushCurrent_v2", self._device.context)
        driver.call("cuThreadExchangeStreamCaptureMode", ctypes.byref(self._mode))
        return driver

    def __exit__(self, *_: object) -> None:
        driver = self._device.driver
        driver.call("cuThreadExchangeStreamCaptureMode", ctypes.byref(self._mode))
        driver.call("cuCtxPopCurrent_v2", ctypes.byref(self._before))


class Mapping:
    """A buffer of the daemon's at an address of this process's, for as long as anybody refers to
    it."""

    def __init__(self, device: Device, fd: int, size: int) -> None:
        self.device = device
        self.nbytes = size
        handle, address = c_ulonglong(), c_ulonglong()
        access = _Access(_Location(_ON_DEVICE, device.number), _READ_WRITE)
        with device.current() as driver, contextlib.ExitStack() as undo:
            driver.call("cuMemImportFromShareableHandle", ctypes.byref(handle), fd, _DESCRIPTOR)
            undo.callback(driver.result, "cuMemRelease", handle)
            with contextlib.ExitStack() as half:
                driver.call("cuMemAddressReserve", ctypes.byref(address), size, 0, 0, 0)
                half.callback(driver.result, "cuMemAddressFree", address, size)
                driver.call("cuMemMap", address, size, 0, handle, 0)
                half.callback(driver.result, "cuMemUnmap", address, size)
                driver.call("cuMemSetAccess", address, size, ctypes.byref(access), 1)
                half.pop_all()
        self.address = int(address.value)
        end = weakref.finalize(self, _unmap, device, self.address, size, os.getpid())
        end.atexit = False


def _unmap(device: Device, address: int, size: int, pid: int) -> None:
    """Frees an address range once nothing on the GPU uses it; does nothing in a forked child."""
    if os.getpid() != pid:
        return
    with device.current() as driver:
        if driver.result("cuCtxSynchronize") == 0:
            driver.result("cuMemUnmap", address, size)
            driver.result("cuMemAddressFree", address, size)


class Fence:
    """Event after all work that this process has given a GPU by now, in all streams."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._event = c_void_p()
        with device.current() as driver:
            driver.call("cuEventCreate", ctypes.byref(self._event), _NO_TIMING)
            code = driver.result("cuCtxRecordEvent", device.context, self._event)
        self._is_recorded = code == 0

    def is_over(self) -> bool:
        """True if that work is done. An event that could not be recorded is tried again."""
        with self._device.current() as driver:
            if not self._is_recorded:
                code = driver.result("cuCtxRecordEvent", self._device.context, self._event)
                self._is_recorded = code == 0
            if not self._is_recorded or driver.result("cuEventQuery", self._event) != 0:
                return False
            driver.result("cuEventDestroy_v2", self._event)
        return True
