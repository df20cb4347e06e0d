"""Planes in a GPU's memory, by a driver without a GPU and a daemon that is a socket: what is
mapped, what consumers are told, when a buffer goes back."""

import ctypes
import gc
import os
import socket
import struct
import threading

import heliograph as hg
import numpy as np
import pytest
import stub_cuda
from heliograph._wire import cuda, shared
from heliograph._wire._proto import render_pb2, types_pb2
from heliograph._wire.device import DeviceArray
from heliograph.render import call

WORD = struct.Struct("=QQ")
SIZE = 1 << 21
FLOATS = np.dtype("<f4")


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    with stub_cuda.loaded(tmp_path_factory.mktemp("cuda")) as stub:
        yield stub


@pytest.fixture
def stub(library):
    yield library
    gc.collect()
    assert (library.depth, library.handles, library.early) == (0, 0, 0)


class Daemon:
    """The other end of the local channel."""

    def __init__(self):
        self.line, client = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.client = client
        greeter = threading.Thread(target=lambda: self.line.send(self.line.recv(64)))
        greeter.start()
        self.shared = shared.share_frames(client, [shared.CAPABILITY])
        greeter.join()
        self.line.setblocking(False)

    def offer(self, number, data, uuid=stub_cuda.UUID):
        fd = os.memfd_create("device")
        os.ftruncate(fd, SIZE)
        os.pwrite(fd, data.tobytes(), 0)
        socket.send_fds(self.line, [WORD.pack(number, SIZE) + uuid], [fd])
        os.close(fd)

    def forget(self, number):
        self.line.send(WORD.pack(number, 0))

    def returned(self):
        """The words that came since the last time."""
        words = []
        while True:
            try:
                words.append(WORD.unpack(self.line.recv(64)))
            except BlockingIOError:
                return words


@pytest.fixture
def daemon(stub):
    made = Daemon()
    yield made
    made.shared._maps.clear()
    made.line.close()
    made.client.close()


def place(buffer, generation, shape, offset=0):
    size = int(np.prod(shape)) * 4
    return types_pb2.BufferRef(buffer=buffer, generation=generation, offset=offset, size=size)


def numbers(*shape, seed=0):
    return np.random.default_rng(seed).random(shape, dtype="f4")


def test_a_plane_on_the_gpu_has_its_numbers_and_says_where_they_are(daemon, stub):
    data = numbers(6, 8, 4)
    daemon.offer(1, data)
    plane = daemon.shared.plane(place(1, 5, data.shape), FLOATS, data.shape)
    assert isinstance(plane, DeviceArray) and np.array_equal(plane.numpy(), data)
    assert (plane.shape, plane.dtype, plane.nbytes, plane.device) == ((6, 8, 4), "f4", 768, 1)
    gpu = plane.__cuda_array_interface__
    assert gpu["shape"] == (6, 8, 4) and gpu["typestr"] == "<f4" and gpu["version"] == 3
    assert gpu["data"] == (plane.pointer, False) and gpu["stream"] is None
    seen = np.ctypeslib.as_array((ctypes.c_float * data.size).from_address(plane.pointer))
    assert np.array_equal(seen.reshape(data.shape), data)  # the stub's memory is the host's
    assert plane.__dlpack_device__() == (2, 1)
    assert stub.mapped == 1 and "GPU 1" in repr(plane)


def test_a_buffer_goes_back_once_the_gpu_is_done_with_it(daemon, stub):
    data = numbers(4, 4)
    daemon.offer(1, data)
    daemon.offer(2, data)
    shape = data.shape
    first = daemon.shared.plane(place(1, 5, shape), FLOATS, shape)
    again = daemon.shared.plane(place(1, 5, shape), FLOATS, shape)
    assert again.pointer == first.pointer  # so that work may be given to the GPU that reads it
    del first
    assert daemon.returned() == []  # another array of the same use
    stub.busy = 1
    del again
    gc.collect()
    assert daemon.returned() == [] and stub.events == 1
    held = daemon.shared.plane(place(2, 6, shape), FLOATS, shape)
    assert daemon.returned() == []
    stub.busy = 0
    same = daemon.shared.plane(place(2, 6, shape), FLOATS, shape)
    assert daemon.returned() == [(1, 5)] and stub.events == 0
    del held, same
    gc.collect()
    assert daemon.returned() == [(2, 6)]


def test_a_buffer_that_nobody_was_shown_goes_back_at_once(daemon, stub):
    data = numbers(4, 4)
    for number, look in ((1, lambda p: p.numpy()), (2, repr), (3, lambda p: p.nbytes)):
        daemon.offer(number, data)
        plane = daemon.shared.plane(place(number, 5, data.shape), FLOATS, data.shape)
        look(plane)
        stub.busy = 1
        del plane
        gc.collect()
        assert daemon.returned() == [(number, 5)] and stub.events == 0
        stub.busy = 0


@pytest.mark.parametrize(
    "show", [lambda p: p.pointer, lambda p: p.__cuda_array_interface__["data"]]
)
def test_a_buffer_that_somebody_was_shown_waits_for_the_gpu(daemon, stub, show):
    data = numbers(4, 4)
    daemon.offer(1, data)
    plane = daemon.shared.plane(place(1, 5, data.shape), FLOATS, data.shape)
    show(plane)
    stub.busy = 1
    del plane
    gc.collect()
    assert daemon.returned() == [] and stub.events == 1
    stub.busy = 0
    daemon.shared._give_back_unused()
    assert daemon.returned() == [(1, 5)] and stub.events == 0


def test_what_cannot_be_fenced_now_goes_back_later(daemon, stub):
    data = numbers(4, 4)
    daemon.offer(1, data)
    plane = daemon.shared.plane(place(1, 5, data.shape), FLOATS, data.shape)
    plane.pointer  # noqa: B018
    stub.capturing = 1
    del plane
    gc.collect()
    assert daemon.returned() == []
    stub.capturing = 0
    daemon.offer(2, data)
    daemon.shared.plane(place(2, 6, data.shape), FLOATS, data.shape)
    assert (1, 5) in daemon.returned()


def test_planes_of_one_buffer_share_a_lease(daemon):
    data = numbers(2, 16, 4)
    daemon.offer(1, data)
    planes = [
        daemon.shared.plane(place(1, 5, (16, 4), offset), FLOATS, (16, 4)) for offset in (0, 256)
    ]
    assert all(np.array_equal(p.numpy(), d) for p, d in zip(planes, data, strict=True))
    del planes[0]
    gc.collect()
    assert daemon.returned() == []
    planes.clear()
    gc.collect()
    assert daemon.returned() == [(1, 5)]


def test_a_forgotten_buffer_is_unmapped_when_nothing_uses_it(daemon, stub):
    data = numbers(4, 4)
    daemon.offer(1, data)
    plane = daemon.shared.plane(place(1, 5, data.shape), FLOATS, data.shape)
    daemon.forget(1)
    daemon.offer(2, data)
    daemon.shared.plane(place(2, 6, data.shape), FLOATS, data.shape)
    assert stub.mapped == 2 and np.array_equal(plane.numpy(), data)
    stub.busy = 1
    del plane
    gc.collect()
    assert stub.mapped == 1 and stub.ranges == 1 and stub.early == 0


def test_a_range_beyond_the_buffer_is_refused(daemon):
    daemon.offer(1, numbers(4))
    with pytest.raises(hg.Internal, match="beyond"):
        daemon.shared.plane(place(1, 5, (4,), SIZE - 8), FLOATS, (4,))


def test_a_gpu_that_this_process_does_not_see(daemon):
    daemon.offer(1, numbers(4), uuid=b"x" * 16)
    with pytest.raises(hg.FailedPrecondition, match="CUDA_VISIBLE_DEVICES"):
        daemon.shared.plane(place(1, 5, (4,)), FLOATS, (4,))


def test_a_mapping_that_fails_leaves_nothing(daemon, stub):
    daemon.offer(1, numbers(4))
    stub.refuses = 1
    try:
        with pytest.raises(hg.Internal, match="cuMemMap"):
            daemon.shared.plane(place(1, 5, (4,)), FLOATS, (4,))
    finally:
        stub.refuses = 0
    assert (stub.ranges, stub.handles, stub.mapped, stub.depth) == (0, 0, 0, 0)


def test_before_a_fork_nobody_can_tell_any_more(daemon):
    daemon.offer(1, numbers(4))
    plane = daemon.shared.plane(place(1, 5, (4,)), FLOATS, (4,))
    daemon.shared.keep_leases()
    assert daemon.returned() == [(5, 0)]
    del plane
    gc.collect()
    assert daemon.returned() == []


# ---------------------------------------------------------------- DLPack


def test_a_capsule_that_is_taken_holds_the_buffer_until_its_deleter_is_called(daemon, dlpack):
    data = numbers(3, 5)
    daemon.offer(1, data)
    plane = daemon.shared.plane(place(1, 5, data.shape), FLOATS, data.shape)
    taken = dlpack.take(plane.__dlpack__(stream=1))
    tensor = taken.tensor
    assert tensor.data == plane.pointer and (tensor.device_type, tensor.device_id) == (2, 1)
    assert (tensor.code, tensor.bits, tensor.lanes, tensor.ndim) == (2, 32, 1, 2)
    assert tensor.shape[:2] == [3, 5] and not tensor.strides and tensor.byte_offset == 0
    del plane
    gc.collect()
    assert daemon.returned() == []
    dlpack.end(taken)
    assert daemon.returned() == [(1, 5)]


def test_a_capsule_that_nobody_takes_ends_by_itself(daemon, dlpack):
    daemon.offer(1, numbers(4))
    plane = daemon.shared.plane(place(1, 5, (4,)), FLOATS, (4,))
    for _ in range(100):
        plane.__dlpack__()
    del plane
    gc.collect()
    assert daemon.returned() == [(1, 5)]


# ---------------------------------------------------------------- frames


def frame_of(daemon, data):
    """A frame of one plane that a chunk names."""
    assembly = call.Assembly(1, daemon.shared)
    header = render_pb2.FrameHeader(height=data.shape[0], width=data.shape[1], final=True)
    info = header.planes.add(name="depth", channels=1, size=data.nbytes, unit="m")
    info.dtype = types_pb2.D_TYPE_F32
    assembly.add_part(render_pb2.FramePart(header=header))
    chunk = render_pb2.PlaneChunk(buffer=place(1, 5, data.shape))
    return assembly.add_part(render_pb2.FramePart(chunk=chunk))


def test_a_frame_on_the_gpu_never_shows_itself_as_one_of_the_host(daemon, tmp_path):
    import pickle

    data = numbers(6, 8)
    daemon.offer(1, data)
    frame = frame_of(daemon, data)
    assert np.array_equal(frame.on_device("depth").numpy(), data)
    with pytest.raises(hg.FailedPrecondition, match=r"frame\.torch\('depth'\)"):
        frame["depth"]
    for name in ("out.npz", "out.png", "out.exr"):
        with pytest.raises(hg.FailedPrecondition, match=r"frame\.cpu\(\)"):
            frame.save(tmp_path / name)
    host = frame.cpu()
    assert np.array_equal(host["depth"], data) and host.cpu() is host
    assert np.array_equal(pickle.loads(pickle.dumps(frame))["depth"], data)
    with pytest.raises(hg.FailedPrecondition, match="device='cuda'"):
        host.on_device("depth")


def test_what_the_request_says_of_the_device(daemon, tmp_path):
    import fake

    with fake.running(tmp_path) as server, hg.connect(server.address) as client:
        scene = client.create_scene("demo")
        scene.render("cam", spp=1, device="cuda")
        assert server.requests[-1].memory == render_pb2.FRAME_MEMORY_CUDA
        scene.render("cam", spp=1, device="cpu")
        assert server.requests[-1].memory == 0
        with pytest.raises(hg.InvalidArgument, match="device"):
            scene.render("cam", spp=1, device="cuda:1")


def test_without_a_driver_the_request_is_not_sent(tmp_path):
    import fake

    before, cuda.LIBRARY = cuda.LIBRARY, str(tmp_path / "none")
    cuda.driver.cache_clear()
    try:
        with fake.running(tmp_path) as server, hg.connect(server.address) as client:
            scene = client.create_scene("demo")
            with pytest.raises(hg.FailedPrecondition, match="no NVIDIA driver") as caught:
                scene.render("cam", spp=1, device="cuda")
            assert caught.value.field == "device" and len(server.requests) == 1
    finally:
        cuda.LIBRARY = before
        cuda.driver.cache_clear()
