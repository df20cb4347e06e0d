"""Frames that stay in the daemon's memory: right, never stale, never written by a client, given
back, and without a descriptor or a mapping for each."""

import fcntl
import gc
import mmap
import os
import socket
import struct
import termios
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire import shared as _shared
from heliograph.render import call

SIZE = (320, 240)
PLANES = ["depth", "normal", "position"]
WORD = struct.Struct("=QQ")


def build(client):
    scene = client.create_scene()
    with scene.edit() as edit:
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
        edit.entity("ball", mesh=mesh)
        lens = hg.Camera.from_fov(50, *SIZE, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
    return scene


def look(scene, k=0, **options):
    """The frame with the ball at place k."""
    with scene.overlay() as overlay:
        overlay.entity("ball", transform=hg.Pose((0.01 * k, 0, 0)))
    return scene.render("cam", planes=PLANES, overlay=overlay, progress=False, **options)


def look_and_release(scene, k):
    """A look whose frame the daemon knows to be given back, which on busy cores it may otherwise
    learn after the next request."""
    look(scene, k)
    local_channel = scene.client.connection.link.shared._local_channel
    until = time.monotonic() + 30
    while fcntl.ioctl(local_channel, termios.TIOCOUTQ, bytes(4)) != bytes(4):
        assert time.monotonic() < until
        time.sleep(0.001)


def content(frame):
    return b"".join(frame[name].tobytes() for name in PLANES)


def maps(client):
    return client.connection.link.shared._maps


@pytest.fixture
def stage():
    with hg.connect() as client:
        yield build(client)


def test_shared_frames_have_the_bytes_of_those_that_travel(stage, monkeypatch):
    monkeypatch.setattr(_shared, "CAPABILITY", "none of these")
    with hg.connect() as other:
        assert other.connection.link.shared is None
        travelled = look(build(other), 3)
    assert stage.client.connection.link.shared is not None
    shared = look(stage, 3)
    assert content(shared) == content(travelled)
    assert 1 <= len(maps(stage.client)) <= len(PLANES)
    for frame in (shared, travelled):
        assert not any(frame[name].flags.writeable for name in PLANES)
    with pytest.raises(ValueError):
        shared["depth"].setflags(write=True)


def test_what_is_held_never_changes_and_what_is_not_is_used_again(stage):
    held = [look(stage, k) for k in range(4)]
    before = [content(frame) for frame in held]
    corner = look(stage, 9)["depth"][110:130, 150:170:2]  # a slice alone keeps its plane
    kept = corner.copy()
    for k in range(30):
        look_and_release(stage, 40 + k)
    assert [content(frame) for frame in held] == before
    assert np.isfinite(kept).all() and np.array_equal(corner, kept)
    used = stage.client.info().used["tenant_bytes"]
    buffers = set(maps(stage.client))
    del held, corner
    gc.collect()
    for k in range(30):
        look_and_release(stage, k)
    assert set(maps(stage.client)) == buffers  # none was made
    assert stage.client.info().used["tenant_bytes"] == used


def resources(client):
    """Descriptors of the daemon, and of this process, and this one's mappings of frames."""
    daemon = client.connection.daemon._process.pid
    with open("/proc/self/maps") as lines:
        mapped = sum("heliograph-frame" in line for line in lines)
    return len(os.listdir(f"/proc/{daemon}/fd")), len(os.listdir("/proc/self/fd")), mapped


def test_frames_that_are_held_cost_neither_descriptors_nor_mappings(stage):
    size = (128, 128)  # planes of 64 KiB: no smaller ones are shared
    options = {"planes": ["depth"], "labels": False, "progress": False, "size": size}
    stage.render("cam", **options)
    before = resources(stage.client)
    held = [stage.render("cam", **options) for _ in range(1000)]
    assert len({frame["depth"].ctypes.data for frame in held}) == 1000
    assert all(now - then <= 10 for now, then in zip(resources(stage.client), before, strict=True))
    used = stage.client.info().used["tenant_bytes"]
    assert used >= 1000 * held[0]["depth"].nbytes
    del held


def test_a_client_that_held_much_gives_its_memory_back(stage, monkeypatch):
    monkeypatch.setattr(_shared, "_SPARE_BYTES", 2 << 20)
    before = resources(stage.client)
    held = [look(stage, k) for k in range(40)]
    expected = content(held[7])
    most = stage.client.info().used["tenant_bytes"]
    kept = held[7]
    del held
    until = time.monotonic() + 30
    while stage.client.info().used["tenant_bytes"] > most // 2:
        assert time.monotonic() < until
        time.sleep(0.01)
    assert content(kept) == expected == content(look(stage, 7))
    del kept
    gc.collect()
    assert resources(stage.client)[2] - before[2] <= 2


def test_streams_and_batches_share_too(stage):
    single = content(look(stage))
    with stage.stream("cam", planes=PLANES) as live:
        assert content(next(live)) == single
    jobs = [hg.Job("cam", tag=k, planes=PLANES) for k in range(6)]
    results = list(stage.render_batch(jobs))
    assert [content(result.frames[0]) for result in results] == [single] * 6
    assert 1 <= len(maps(stage.client)) <= 6


def test_frames_outlive_their_client_and_daemon():
    with hg.connect() as client:
        frame = look(build(client), 1)
        before = content(frame)
    assert content(frame) == before


def test_a_forked_child_keeps_what_it_has(stage):
    frame = look(stage, 1)
    expected = content(frame)
    wait, go = os.pipe()
    child = os.fork()
    if child == 0:
        os.read(wait, 1)
        same = content(frame) == expected
        os._exit(0 if same else 1)
    del frame
    gc.collect()
    for k in range(20):
        look(stage, 20 + k)
    os.write(go, b"x")
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    os.close(wait)
    os.close(go)


def test_cancelled_calls_leave_no_buffers(stage):
    def cancelled():
        with stage.stream("cam", planes=PLANES) as live:
            next(live)

    for _ in range(40):
        cancelled()
    gc.collect()
    look(stage)
    assert len(maps(stage.client)) <= 4 * len(PLANES)


def test_without_room_frames_travel():
    with hg.connect(arguments=["--limit", "shared_bytes=300000"]) as client:
        scene = build(client)
        held = [look(scene, k) for k in range(4)]  # planes of 307 kB and more
        assert not maps(client)
        assert len({content(frame) for frame in held}) == 4


def wish(path):
    """A local channel that has asked for buffers, with its session open."""
    import grpc
    from heliograph._wire._proto import service_pb2 as service
    from heliograph._wire._proto import service_pb2_grpc as stubs

    line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    line.settimeout(10)
    line.connect(path + ".fd.sock")
    channel = grpc.insecure_channel("unix://" + path)
    stub = stubs.RendererStub(channel)
    session = stub.OpenSession(service.OpenSessionRequest(ticket=line.recv(64))).session
    line.send(WORD.pack(0, 0))
    assert WORD.unpack(line.recv(64)) == (0, 0)
    return line, channel, stub, (("heliograph-session", str(session)),)


def test_words_that_mean_nothing_harm_nothing(stage):
    path = stage.client.address.removeprefix("unix://")
    line, channel, _, _ = wish(path)
    before = content(look(stage))
    for word in (b"", b"x", b"y" * 200, WORD.pack(7, 9), WORD.pack(2**64 - 1, 0), WORD.pack(0, 0)):
        line.send(word)
    for k in range(500):
        line.send(WORD.pack(k, k))
    assert content(look(stage)) == before
    line.close()
    channel.close()
    assert content(look(stage)) == before


@pytest.mark.parametrize("in_header", [False, True], ids=["in chunks", "in the header"])
def test_a_client_can_only_read(stage, in_header):
    line, channel, stub, metadata = wish(stage.client.address.removeprefix("unix://"))
    request = call.make_request(stage, ["cam"], {"planes": PLANES})
    request.buffers_in_header = in_header
    parts = list(stub.Render(request, metadata=metadata))
    chunks = [part.chunk.buffer for part in parts if part.WhichOneof("part") == "chunk"]
    planes = [plane for part in parts for plane in part.header.planes]
    assert all(plane.HasField("buffer") == in_header for plane in planes)
    assert not (in_header and chunks)
    places = [plane.buffer for plane in planes] if in_header else chunks
    assert len(places) == len(PLANES)
    sizes = {}
    for _ in {place.buffer for place in places}:
        word, (fd,), _, _ = socket.recv_fds(line, WORD.size, 4)
        buffer, sizes[buffer] = WORD.unpack(word)
        check_read_only(fd, sizes[buffer])
    for place in places:
        assert place.offset % 64 == 0 and place.offset + place.size <= sizes[place.buffer]
    line.close()
    channel.close()


def check_read_only(fd, size):
    assert os.fstat(fd).st_size == size
    with pytest.raises(PermissionError):
        mmap.mmap(fd, size, mmap.MAP_SHARED, mmap.PROT_WRITE)
    for attack in (
        lambda: os.ftruncate(fd, 0),
        lambda: os.ftruncate(fd, 2 * size),
        lambda: os.pwrite(fd, b"x", 0),
    ):
        with pytest.raises(PermissionError):
            attack()
    os.close(fd)


@pytest.mark.parametrize("segments, uploads", [(128, 0), (512, 2)], ids=["copied", "mapped"])
def test_arrays_travel_in_memory_too(stage, monkeypatch, segments, uploads):
    """Arrays of a mesh that moves: without an upload, and with the same bytes."""
    sphere = hg.shapes.sphere(0.5, segments=segments)
    assert 1 << 16 < sphere["positions"].nbytes
    assert (sphere["positions"].nbytes > 1 << 20) == (uploads > 0)
    links = []

    def frame(client):
        scene = build(client)
        pushed = []
        push = client.connection.push
        monkeypatch.setattr(
            client.connection, "push", lambda *a: (pushed.append(a[0]), push(*a))[1]
        )
        with scene.edit() as edit:
            edit.mesh("mesh", **sphere)
        pushed.clear()
        for k in (1, 2):
            with scene.edit() as edit:
                edit.mesh("mesh", positions=sphere["positions"] * (1 + 0.1 * k))
        links.append(pushed)
        return content(scene.render("cam", planes=PLANES, progress=False))

    shared = frame(stage.client)
    monkeypatch.setattr(_shared, "CAPABILITY", "none of these")
    with hg.connect() as other:
        assert frame(other) == shared
    assert links == [[], ["UploadBlob"] * uploads]
