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
_WISH = _WORD.pack(0, 1)  # with a socket: answer what comes over it
_SIZE = struct.Struct("=Q")
_PACKET_BYTES = 64 << 10
QUICK_BYTES = _PACKET_BYTES - 1024  # of a request; a token has room beside it


def open_quick_line(
    lifeline: socket.socket | None, capabilities: Iterable[str]
) -> QuickLine | None:
    """None where the daemon, or the way to it, has none."""
    if lifeline is None or _CAPABILITY not in capabilities:
        return None
    return QuickLine(lifeline)


class QuickLine:
    """One call at a time. Thread: any; whoever comes while another's call is under way is told to
    go by gRPC."""

    def __init__(self, lifeline: socket.socket) -> None:
        self._lifeline = lifeline
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None

    def ask(
        self, call: service.QuickCall, on_progress: Callable[[Any], None] | None = None
    ) -> service.QuickReply | None:
        """The reply, which may be a refusal; None: it must go by gRPC. `on_progress` is told
        v1.Progress. An exception in the middle, such as KeyboardInterrupt, cancels the call."""
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
        """What answers a packet; None where the daemon is gone, or closed the socket."""
        last = None
        try:
            line = self._socket or self._open()
            line.send(data)
            while answer := _receive(line):
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
            socket.send_fds(self._lifeline, [_WISH], [theirs.fileno()])
        self._socket = ours
        return ours

    def end(self) -> None:
        """From any thread: a call that is under way is cancelled."""
        line = self._socket
        if line is not None:
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Gives up this process's end. The next call opens another socket."""
        line, self._socket = self._socket, None
        if line is not None:
            line.close()


def _receive(line: socket.socket) -> bytes:
    data, fds, _, _ = socket.recv_fds(line, _PACKET_BYTES, 1)
    if not fds:
        return data
    with open(fds[0], "rb") as memory:  # a memfd, with what a packet has no room for
        size: int = _SIZE.unpack(data)[0]
        return os.pread(memory.fileno(), size, 0)
