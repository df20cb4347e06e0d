"""The library of clients/python/native/dlpack.c, and what a consumer does with its capsules."""

import contextlib
import ctypes
import pathlib
import subprocess

from heliograph._wire import dlpack

SOURCE = pathlib.Path(__file__).parents[2] / "clients/python/native/dlpack.c"

_get = ctypes.pythonapi.PyCapsule_GetPointer
_get.argtypes, _get.restype = [ctypes.py_object, ctypes.c_char_p], ctypes.c_void_p
_rename = ctypes.pythonapi.PyCapsule_SetName
_rename.argtypes = [ctypes.py_object, ctypes.c_char_p]
_TAKEN = b"used_dltensor"  # a capsule keeps the pointer


class Managed(ctypes.Structure):
    """DLManagedTensor."""

    _fields_ = (
        ("tensor", dlpack.Tensor),
        ("manager_ctx", ctypes.c_void_p),
        ("deleter", ctypes.c_void_p),
    )


def compiled(folder):
    """A folder with the library, and a daemon that nobody starts."""
    flags = ["-std=c11", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", "-fvisibility=hidden"]
    subprocess.run(["cc", *flags, "-o", folder / dlpack.LIBRARY, SOURCE], check=True)
    (folder / "heliographd").touch()
    return folder


@contextlib.contextmanager
def found(folder, monkeypatch):
    monkeypatch.setenv("HELIOGRAPHD", str(folder / "heliographd"))
    dlpack._function.cache_clear()
    yield
    dlpack._function.cache_clear()


def take(capsule):
    """Content of a capsule, which is the caller's from now on."""
    where = _get(capsule, b"dltensor")
    _rename(capsule, _TAKEN)
    return Managed.from_address(where)


def end(taken):
    """Calls the deleter as a consumer does that knows no Python: without its lock."""
    ctypes.CFUNCTYPE(None, ctypes.c_void_p)(taken.deleter)(ctypes.addressof(taken))
