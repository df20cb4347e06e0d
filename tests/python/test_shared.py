"""Frames in ranges of the daemon's buffers, with a daemon of two sockets: what is a view of what,
what is said when the last view is gone, and what stays mapped."""

import gc
import os
import socket
import struct
import sys
import threading

import numpy as np
import pytest
from heliograph._wire import shared
from heliograph._wire._proto import types_pb2

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="is for Linux")

WORD = struct.Struct("=QQ")
MIB = 1 << 20
UNMAPPED = 2**64 - 1
FLOATS = np.dtype("f4")


class Daemon:
    """The other end of the local channel of one client."""

    def __init__(self):
        self.line, self.client = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        greeter = threading.Thread(target=lambda: self.line.send(self.line.recv(64)))
        greeter.start()
        self.shared = shared.share_frames(self.client, [shared.CAPABILITY])
        greeter.join()
        self.line.setblocking(False)
        self.files = {}

    def offer(self, number, size=MIB):
        if number not in self.files:
            self.files[number] = os.memfd_create("arena")
            os.ftruncate(self.files[number], size)
        socket.send_fds(self.line, [WORD.pack(number, size)], [self.files[number]])

    def plane(self, buffer, generation, offset=0, count=16):
        """With its generation in each number."""
        data = np.full(count, generation, FLOATS)
        os.pwrite(self.files[buffer], data.tobytes(), offset)
        place = types_pb2.BufferRef(
            buffer=buffer, generation=generation, offset=offset, size=data.nbytes
        )
        return self.shared.plane(place, FLOATS, [count])

    def received(self):
        words = []
        while True:
            try:
                words.append(WORD.unpack(self.line.recv(64)))
            except BlockingIOError:
                return words


@pytest.fixture
def daemon():
    made = Daemon()
    yield made
    for fd in made.files.values():
        os.close(fd)
    made.line.close()
    made.client.close()


def test_many_planes_are_views_of_one_mapping_and_each_comes_back_by_itself(daemon):
    daemon.offer(1)
    planes = {5 + k: daemon.plane(1, 5 + k, 64 * k) for k in range(1000)}
    assert list(daemon.shared._maps) == [1]
    assert all((plane == generation).all() for generation, plane in planes.items())
    kept = planes.pop(700)[3:5]
    assert not kept.flags.writeable and daemon.received() == []
    for generation in (5, 6, 900):
        del planes[generation]
        assert daemon.received() == [(1, generation)]
    for generation in list(planes):
        del planes[generation]
        assert daemon.received() == [(1, generation)]
    assert (kept == 700).all()
    del kept
    assert daemon.received() == [(1, 700)]


def test_planes_of_one_generation_come_back_together(daemon):
    daemon.offer(1)
    first, second = daemon.plane(1, 5), daemon.plane(1, 5, 4096)
    del first
    assert daemon.received() == []
    del second
    assert daemon.received() == [(1, 5)]


def test_what_is_mapped_without_a_frame_is_bounded(daemon, monkeypatch):
    monkeypatch.setattr(shared, "_SPARE_BYTES", 2 * MIB)
    for number in (1, 2, 3, 4):
        daemon.offer(number)
    planes = [daemon.plane(1 + k % 4, 5 + k, 64 * k) for k in range(12)]
    del planes[::2]  # all of 1 and 3
    assert daemon.received() == [(1, 5), (3, 7), (1, 9), (3, 11), (1, 13), (3, 15)]
    del planes[:]
    received = [word for word in daemon.received() if word[1] == UNMAPPED]
    assert sorted(received) == [(2, UNMAPPED), (4, UNMAPPED)]
    assert set(daemon.shared._maps) == {1, 3}
    daemon.offer(4)
    assert (daemon.plane(4, 30) == 30).all()  # once it is here again


def test_a_plane_keeps_its_pixels_when_its_buffer_is_forgotten(daemon):
    daemon.offer(1)
    plane = daemon.plane(1, 5)
    daemon.line.send(WORD.pack(1, 0))
    daemon.offer(2)
    assert (daemon.plane(2, 6) == 6).all()
    assert list(daemon.shared._maps) == [2] and (plane == 5).all()


def test_before_a_fork_nobody_can_tell_any_more(daemon):
    daemon.offer(1)
    planes = [daemon.plane(1, 5), daemon.plane(1, 6, 64)]
    daemon.shared.keep_leases()
    assert sorted(daemon.received()) == [(5, 0), (6, 0)]
    del planes
    gc.collect()
    assert daemon.received() == []


def test_no_word_is_lost_where_threads_let_go_at_once(daemon):
    daemon.offer(1)
    planes = [[daemon.plane(1, 5 + 500 * t + k, 64 * k) for k in range(500)] for t in range(4)]
    received = []
    threads = [threading.Thread(target=each.clear) for each in planes]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        received += daemon.received()
    last = daemon.plane(1, 4)
    while daemon.shared._unsent:
        received += daemon.received()
        daemon.shared._send(WORD.pack(0, 1))
    received += daemon.received()
    assert sorted(word for word in received if word[0]) == [(1, 5 + k) for k in range(2000)]
    assert (last == 4).all()
