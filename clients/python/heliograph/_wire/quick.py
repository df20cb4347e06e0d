"""Quick calls: Apply and Render over a socket of the session's own, a packet each way. They spare a
small frame half a millisecond that gRPC takes. Used by link.py."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from typing import Any

from ._proto import service_pb2 as service

_CAPABILITY = "quick_calls"
_WORD = struct.Struct("=QQ")
_OFFER = _WORD.pack(0, 1)  # with a socket: answer its requests
_SIZE = struct.Struct("=Q")
_PACKET_BYTES = 64 << 10
QUICK_BYTES = _PACKET_BYTES - 1024  # of a request; a token has room beside it


def open_fast_path(
    local_channel: socket.socket | None, capabilities: Iterable[str]
) -> FastPathConnection | None:
    """Returns None where the daemon, or the connection to it, offers no quick calls."""
    if local_channel is None or _CAPABILITY not in capabilities:
        return None
    return FastPathConnection(local_channel)


class FastPathConnection:
    """The socket of a session's quick calls, one at a time. Thread: any; a call that comes while
    another is in flight goes by gRPC."""

    def __init__(self, local_channel: socket.socket) -> None:
        self._local_channel = local_channel
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None

    def ask(
        self, call: service.QuickCall, on_progress: Callable[[Any], None] | None = None
    ) -> service.QuickReply | None:
        """Returns the reply, which may be a refusal; None: the call must go by gRPC. `on_progress`
        gets each v1.Progress. An exception, such as KeyboardInterrupt, cancels the call."""
        call.progress = on_progress is not None
        if not self._lock.acquire(blocking=False):
            return None
        try:
            data = call.SerializeToString()
            if len(data) > _PACKET_BYTES:
                return None
            return self._exchange(data, on_progress)
        finally:
            self._lock.release()

    def _exchange(
        self, data: bytes, on_progress: Callable[[Any], None] | None
    ) -> service.QuickReply | None:
        """Sends a packet, returns its reply; None where the daemon is gone or closed the socket."""
        last = None
        try:
            connection = self._socket or self._open()
            connection.send(data)
            while answer := _receive(connection):
                reply = service.QuickReply.FromString(answer)
                if not reply.HasField("progress"):
                    last = reply
                    return reply
                if on_progress is not None:
                    on_progress(reply.progress)
        except OSError:
            pass
        finally:
            if last is None:
                self.close()
        return None

    def _open(self) -> socket.socket:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            socket.send_fds(self._local_channel, [_OFFER], [theirs.fileno()])
        self._socket = ours
        return ours

    def end(self) -> None:
        """Cancels the call in flight. Thread: any."""
        connection = self._socket
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Closes this process's end. The next call opens another socket."""
        connection, self._socket = self._socket, None
        if connection is not None:
            connection.close()


def _receive(connection: socket.socket) -> bytes:
    data, fds, _, _ = socket.recv_fds(connection, _PACKET_BYTES, 1)
    if not fds:
        return data
    with open(fds[0], "rb") as memory:  # a memfd: the reply exceeds a packet
        size: int = _SIZE.unpack(data)[0]
        return os.pread(memory.fileno(), size, 0)
