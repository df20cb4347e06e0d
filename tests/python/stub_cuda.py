"""The libcuda of stub_cuda.c, for tests of frames on a GPU where there is none."""

import contextlib
import ctypes
import pathlib
import subprocess

from heliograph._wire import cuda

UUID = b"heliograph\0\1\2\3\4\5"


class Stub:
    """Its counters and switches as attributes: stub.busy, stub.mapped."""

    def __init__(self, library):
        object.__setattr__(self, "_library", library)

    def __getattr__(self, name):
        return ctypes.c_int.in_dll(self._library, f"stub_{name}").value

    def __setattr__(self, name, value):
        ctypes.c_int.in_dll(self._library, f"stub_{name}").value = value


@contextlib.contextmanager
def loaded(folder):
    """The client's driver is the stub, compiled in `folder`."""
    target = pathlib.Path(folder) / "libcuda.so.1"
    source = pathlib.Path(__file__).with_suffix(".c")
    command = ["cc", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-o", target, source]
    subprocess.run(command, check=True)
    before, cuda.LIBRARY = cuda.LIBRARY, str(target)
    cuda.driver.cache_clear()
    try:
        yield Stub(ctypes.CDLL(str(target)))
    finally:
        cuda.LIBRARY = before
        cuda.driver.cache_clear()
