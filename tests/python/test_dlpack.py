"""DLPack capsules of planes, taken by NumPy from memory of the host: what they say, and when the
use of a buffer ends, in whatever thread and at whatever time."""

import ctypes
import gc
import os
import pathlib
import subprocess
import sys
import threading
import types
import weakref

import native_dlpack
import numpy as np
import pytest
from heliograph._wire import dlpack as _dlpack
from heliograph._wire.device import DeviceArray, DeviceLease

HERE = pathlib.Path(__file__).parent
HOST = (1, 0)  # kDLCPU


class HostArray(DeviceArray):
    """A plane in memory of the host, for the consumer that is there without a GPU."""

    def __dlpack_device__(self):
        return HOST


def host_array(data):
    mapping = types.SimpleNamespace(
        address=data.ctypes.data, device=types.SimpleNamespace(number=0), data=data
    )
    return HostArray(DeviceLease(mapping), 0, data.dtype, data.shape)


def leased(data):
    """(a plane, a list that gets True each time its lease ends)."""
    plane, ends = host_array(data), []
    weakref.finalize(plane._lease, ends.append, True)
    return plane, ends


def child(code):
    """A process of its own that runs `code`, with `array` made there."""
    begin = """
import numpy as np, test_dlpack
array = test_dlpack.host_array(np.arange(12, dtype="f4").reshape(3, 4))
"""
    path = os.pathsep.join([str(HERE), *sys.path])
    return subprocess.run(
        [sys.executable, "-c", begin + code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=60,
    )


def resident():
    """Bytes of memory that this process has."""
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


@pytest.mark.parametrize("dtype", ["f4", "f2", "u4", "u1", "i4"])
@pytest.mark.parametrize("shape", [(6,), (2, 3), (3, 1, 2)])
def test_an_array_of_the_same_memory(dlpack, dtype, shape):
    data = np.arange(6).astype(dtype).reshape(shape)
    array = np.from_dlpack(host_array(data))
    assert array.dtype == data.dtype and array.shape == shape and np.array_equal(array, data)
    assert array.ctypes.data == data.ctypes.data


def test_the_lease_lives_as_long_as_a_view_of_the_array_and_ends_once(dlpack):
    plane, ends = leased(np.ones((3, 4), "f4"))
    view = np.from_dlpack(plane)[1:, 2]
    del plane
    gc.collect()
    assert ends == [] and np.array_equal(view, [1, 1])
    del view
    assert ends == [True]


def test_each_capsule_has_one_reference_and_gives_it_back(dlpack):
    plane = host_array(np.ones(4, "f4"))
    counts = [sys.getrefcount(plane._lease)]
    arrays = [np.from_dlpack(plane) for _ in range(10)]
    capsules = [plane.__dlpack__() for _ in range(5)]
    counts.append(sys.getrefcount(plane._lease))
    arrays.clear()
    counts.append(sys.getrefcount(plane._lease))
    capsules.clear()
    counts.append(sys.getrefcount(plane._lease))
    assert np.diff(counts).tolist() == [15, -10, -5]


def test_the_last_array_dies_in_another_thread(dlpack):
    plane, ends = leased(np.ones(4, "f4"))
    held = [np.from_dlpack(plane)]
    del plane
    thread = threading.Thread(target=held.clear)
    thread.start()
    thread.join()
    assert ends == [True]


def test_a_consumer_lets_go_in_a_thread_that_python_does_not_know(dlpack):
    process = ctypes.CDLL(None)
    for _ in range(20):
        plane, ends = leased(np.ones(4, "f4"))
        taken = dlpack.take(plane.__dlpack__())
        del plane
        thread, where = ctypes.c_ulong(), ctypes.c_void_p(ctypes.addressof(taken))
        deleter = ctypes.c_void_p(taken.deleter)
        assert process.pthread_create(ctypes.byref(thread), None, deleter, where) == 0
        assert process.pthread_join(thread, None) == 0
        assert ends == [True]


def test_a_capsule_that_nobody_took_gives_its_lease_back(dlpack):
    plane, ends = leased(np.ones(4, "f4"))
    capsule = plane.__dlpack__()
    del plane
    assert ends == []
    del capsule
    assert ends == [True]


def test_capsules_leave_no_memory_behind(dlpack):
    plane = host_array(np.ones((2, 3, 4), "f4"))

    def some(count):
        for _ in range(count):
            np.from_dlpack(plane)
            plane.__dlpack__()
        return resident()

    before = some(2_000)
    assert some(50_000) < before + (2 << 20)  # 100,000 blocks of 96 bytes are 9 MB


class ToldLease(DeviceLease):
    def __del__(self, write=os.write):
        write(1, b"the lease ended")


@pytest.mark.parametrize("held", ["np.from_dlpack(array)", "array.__dlpack__()"])
def test_python_ends_while_an_array_lives(dlpack, held):
    """Then nothing of Python's is called any more, so that the lease never ends."""
    code = f"""
array._lease.__class__ = test_dlpack.ToldLease
kept = {held}
del array
print("end")
"""
    done = child(code)
    assert (done.returncode, done.stdout, done.stderr) == (0, "end\n", "")


def test_a_consumer_lets_go_after_python_has_ended(dlpack):
    code = """
import ctypes, native_dlpack
taken = native_dlpack.take(array.__dlpack__())
deleter, where = ctypes.c_void_p(taken.deleter), ctypes.c_void_p(ctypes.addressof(taken))
print(ctypes.CDLL(None).__cxa_atexit(deleter, where, None))
"""
    done = child(code)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


# ---------------------------------------------------------------- what the array API asks


def test_keywords_that_a_plane_can_follow(dlpack):
    plane = host_array(np.ones(4, "f4"))
    for asked in (
        {"stream": None, "max_version": (1, 1), "dl_device": HOST, "copy": False},
        {"stream": 2, "max_version": (0, 8), "dl_device": list(HOST), "copy": None},
    ):
        assert "dltensor" in repr(plane.__dlpack__(**asked))


def test_a_copy_and_another_device_are_refused(dlpack):
    plane = host_array(np.ones(4, "f4"))
    with pytest.raises(BufferError, match="without a copy"):
        plane.__dlpack__(copy=True)
    with pytest.raises(BufferError, match=r"device \(1, 0\).* to \(2, 1\).*numpy\(\)"):
        plane.__dlpack__(dl_device=(2, 1))
    with pytest.raises(TypeError):
        plane.__dlpack__(flags=1)


# ---------------------------------------------------------------- with the library and without


@pytest.fixture
def torch(monkeypatch):
    """A PyTorch that records which way a tensor came."""
    made = types.SimpleNamespace(
        from_dlpack=lambda array: ("dlpack", array),
        as_tensor=lambda array, device: ("array interface", array, device),
    )
    monkeypatch.setitem(sys.modules, "torch", made)
    return made


def test_a_tensor_comes_through_dlpack(dlpack, torch):
    data = np.arange(4, dtype="f4")
    way, capsule = host_array(data).torch()
    assert way == "dlpack"
    taken = types.SimpleNamespace(__dlpack__=lambda **_: capsule, __dlpack_device__=lambda: HOST)
    assert np.array_equal(np.from_dlpack(taken), data)


def test_without_the_library_there_is_no_capsule_but_a_tensor(dlpack, torch, monkeypatch):
    monkeypatch.setattr(_dlpack, "LIBRARY", "heliograph-none.so")
    plane = host_array(np.ones(4, "f4"))
    with pytest.raises(BufferError, match=r"no heliograph-none\.so beside .*_bin or set HELIOGR"):
        plane.__dlpack__()
    assert plane.torch() == ("array interface", plane, "cuda:0")


def test_a_library_that_does_not_load_is_named(torch, tmp_path, monkeypatch):
    (tmp_path / _dlpack.LIBRARY).write_text("no library")
    plane = host_array(np.ones(4, "f4"))
    with (
        native_dlpack.found(tmp_path, monkeypatch),
        pytest.raises(BufferError, match=f"{tmp_path}.* does not load"),
    ):
        plane.torch()
