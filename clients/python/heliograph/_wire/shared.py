"""Memory that this process and the daemon share: frames, and arrays on their way to a scene.

The arrays of a frame are views of ranges of the daemon's buffers; a few buffers hold all frames.
When the last array of a range is gone it goes back to the daemon, which never writes there before
that; a range of a GPU's memory, when the GPU has finished its work until then. Arrays travel in
sealed memfds of this process. Used by link.py and arrays.py.
"""

from __future__ import annotations

import itertools
import mmap
import os
import socket
import struct
import threading
import weakref
from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import Internal, Unavailable
from . import cuda
from ._proto import types_pb2 as types
from .device import DeviceArray, DeviceLease

if TYPE_CHECKING:
    from .arrays import NdArray

CAPABILITY = "shared_memory"
_WORD = struct.Struct("=QQ")
_UUID_BYTES = 16  # after the message of a new buffer in a GPU's memory
_WISH = _WORD.pack(0, 0)
_NEVER = 0  # after a generation: it will never be returned
_UNMAPPED = (1 << 64) - 1  # after a buffer: it is unmapped
_SPARE_BYTES = 256 << 20  # of buffers without a frame that stay mapped for reuse


def share_frames(
    local_channel: socket.socket | None, capabilities: Iterable[str]
) -> SharedFrames | None:
    """Returns the mapped buffers of a session; None: frames come as bytes."""
    if local_channel is None or CAPABILITY not in capabilities:
        return None
    return SharedFrames(local_channel)


class Arena:
    """A buffer of the host's memory, mapped for reading."""

    def __init__(self, fd: int, size: int) -> None:
        self.memory = mmap.mmap(fd, size, mmap.MAP_SHARED, mmap.PROT_READ)
        self.nbytes = size
        self.used: set[int] = set()  # generations that have arrays


class SharedFrames:
    """The mapped buffers of one session. Thread: any."""

    def __init__(self, local_channel: socket.socket) -> None:
        self._local_channel = local_channel
        self._pid = os.getpid()
        self._lock = threading.Lock()  # of _maps and of reading the socket
        self._maps: dict[int, Arena | cuda.Mapping] = {}
        self._leases: dict[tuple[int, int], weakref.ref[NdArray | DeviceLease]] = {}
        self._unsent: deque[bytes] = deque()
        self._in_use: deque[tuple[cuda.Fence, bytes]] = deque()  # messages to send after a fence
        self._numbers = itertools.count(1)  # of buffers handed over
        try:
            local_channel.send(_WISH)
            answer = local_channel.recv(_WORD.size)  # the same: from now on
        except OSError:
            answer = b""
        if not answer:
            raise Unavailable("the daemon ended while a session was opened")
        if answer != _WISH:
            raise Internal("the daemon's local channel does not answer")

    def plane(
        self, place: types.BufferRef, dtype: np.dtype[Any], shape: Sequence[int]
    ) -> NdArray | DeviceArray:
        """Returns the array that a chunk names, read-only. It is leased while it lives."""
        self._give_back_unused()
        key = (place.buffer, place.generation)
        known = self._leases.get(key)
        lease = known() if known is not None else None
        if lease is None:
            lease = self._lease(key)
        size = lease.nbytes if isinstance(lease, np.ndarray) else lease.mapping.nbytes
        if place.offset + place.size > size:
            raise Internal(f"the daemon named bytes beyond its buffer of {size}")
        if isinstance(lease, DeviceLease):
            return DeviceArray(lease, place.offset, dtype, shape)
        data = lease[place.offset : place.offset + place.size]
        return data.view(dtype).reshape(tuple(shape))

    def _lease(self, key: tuple[int, int]) -> NdArray | DeviceLease:
        buffer = self._map(*key)
        lease: NdArray | DeviceLease
        readers: list[cuda.Device] = []
        if isinstance(buffer, cuda.Mapping):
            lease = DeviceLease(buffer)
            readers = lease.readers
        else:
            lease = np.frombuffer(buffer.memory, dtype=np.uint8)
        self._leases[key] = weakref.ref(lease)
        weakref.finalize(lease, self._give_back, key, buffer, readers).atexit = False
        return lease

    def hand_over(self, data: memoryview) -> types.BufferRef:
        """Copies bytes, (size,) u8, into a buffer that one array of this session may name."""
        with self._lock:
            number = next(self._numbers)
        fd = _sealed_copy(data)
        try:
            socket.send_fds(self._local_channel, [_WORD.pack(number, data.nbytes)], [fd])
        except OSError as error:
            raise Unavailable(f"the daemon's local channel ended: {error}") from None
        finally:
            os.close(fd)
        return types.BufferRef(buffer=number, size=data.nbytes)

    def mapping(self, buffer: int) -> cuda.Mapping:
        """Returns the mapping of a buffer that the daemon lent."""
        found = self._map(buffer, _NEVER)
        if not isinstance(found, cuda.Mapping):
            raise Internal("the daemon lent memory of the host")
        return found

    def give_back(self, place: types.BufferRef) -> None:
        """Returns a buffer that the daemon lent."""
        self._send(_WORD.pack(place.buffer, place.generation))

    def _map(self, buffer: int, generation: int) -> Arena | cuda.Mapping:
        with self._lock:
            while buffer not in self._maps:
                self._poll()
            found = self._maps[buffer]
            if isinstance(found, Arena):
                found.used.add(generation)
            return found

    def _poll(self) -> None:
        """Reads one message of the daemon: a new buffer, or one to forget."""
        word, fds, _, _ = socket.recv_fds(self._local_channel, _WORD.size + _UUID_BYTES, 1)
        if len(word) < _WORD.size:
            raise Internal("the daemon's local channel ended")
        buffer, size = _WORD.unpack_from(word)
        if not fds:
            self._maps.pop(buffer, None)
            return
        try:
            uuid = word[_WORD.size :]
            self._maps[buffer] = (
                cuda.Mapping(cuda.driver().device(uuid), fds[0], size)
                if uuid
                else Arena(fds[0], size)
            )
        finally:
            os.close(fds[0])

    def _give_back(
        self, key: tuple[int, int], buffer: Arena | cuda.Mapping, readers: list[cuda.Device]
    ) -> None:
        """Returns a lease whose last array is gone. Thread: any; a finalizer, so it never waits."""
        if os.getpid() != self._pid or self._leases.pop(key, None) is None:
            return
        if isinstance(buffer, Arena):
            buffer.used.discard(key[1])
        if not readers:
            self._send(_WORD.pack(*key))
            if isinstance(buffer, Arena) and not buffer.used:
                self._let_go(key[0])
            return
        self._in_use.append((cuda.Fence(readers[0]), _WORD.pack(*key)))
        self._give_back_unused()

    def _give_back_unused(self) -> None:
        """Returns the leases in a GPU's memory whose fence the GPU has passed."""
        for _ in range(len(self._in_use)):
            try:
                fence, word = self._in_use.popleft()
            except IndexError:
                return
            if fence.is_over():
                self._send(word)
            else:
                self._in_use.append((fence, word))

    def _let_go(self, number: int) -> None:
        """Unmaps a buffer without frames where more than _SPARE_BYTES of such are mapped."""
        if not self._lock.acquire(blocking=False):
            return  # with the next one
        try:
            arenas = [each for each in self._maps.values() if isinstance(each, Arena)]
            spare = sum(arena.nbytes for arena in arenas if not arena.used)
            found = self._maps.get(number)
            if spare <= _SPARE_BYTES or not isinstance(found, Arena) or found.used:
                return
            del self._maps[number]
        finally:
            self._lock.release()
        self._send(_WORD.pack(number, _UNMAPPED))

    def _send(self, word: bytes) -> None:
        self._unsent.append(word)
        try:
            while True:
                word = self._unsent.popleft()  # first: other threads and finalizers send too
                try:
                    self._local_channel.send(word, socket.MSG_DONTWAIT)
                except (BlockingIOError, TimeoutError):
                    self._unsent.appendleft(word)  # with the next one
                    return
        except (OSError, IndexError):
            pass  # closed: the daemon knows

    def keep_leases(self) -> None:
        """Called before os.fork: a child may read these arrays longer than this process does,
        so the daemon must not reuse them."""
        for key in list(self._leases):
            if self._leases.pop(key, None) is not None:
                self._send(_WORD.pack(key[1], _NEVER))


def _sealed_copy(data: memoryview) -> int:
    """Returns a memfd with these bytes, sealed against changes."""
    import fcntl  # of Linux, as is all that needs it

    fd = os.memfd_create("heliograph-array", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        left = data
        while left.nbytes:
            left = left[os.write(fd, left) :]
        seals = fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        fcntl.fcntl(fd, fcntl.F_ADD_SEALS, seals)
    except BaseException:
        os.close(fd)
        raise
    return fd
