"""Session with a daemon over one channel, and its local channel. Used by connection.py."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import grpc
from google.protobuf import message_factory

from .._version import __version__
from ..errors import FailedPrecondition, Unavailable
from ._proto import service_pb2 as service
from .access import Access
from .quick import FastPathConnection, open_fast_path
from .shared import share_frames
from .start import Deadline
from .status import status_error, to_error

API = 1  # the version of the contract, heliograph.vN, that this client speaks
RETRY_SECONDS = 10.0  # how long an unreachable daemon is tried again
_METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name
_TICKET_BYTES = 16
_UNAVAILABLE = grpc.StatusCode.UNAVAILABLE.value[0]
_UNAUTHENTICATED = grpc.StatusCode.UNAUTHENTICATED.value[0]


class Patience:
    """The waits between repeated calls: 20 ms, doubling up to 250 ms, RETRY_SECONDS in all."""

    def __init__(self, seconds: float | None = None) -> None:
        self._until = time.monotonic() + (RETRY_SECONDS if seconds is None else seconds)
        self._delay = 0.02

    def wait(self) -> bool:
        """Sleeps; False, at once, when there is no more time."""
        if time.monotonic() > self._until:
            return False
        time.sleep(self._delay)
        self._delay = min(2 * self._delay, 0.25)
        return True


def _check_api(server: service.GetServerInfoReply) -> None:
    if server.max_api and not server.min_api <= API <= server.max_api:
        raise FailedPrecondition(
            f"this daemon ({server.version}) speaks versions {server.min_api} to {server.max_api} "
            f"of the protocol and this client {API}; install the client of the daemon's version"
        )


class LocalChannel(socket.socket):
    """The socket that keeps a session, and a private daemon, alive. Frames in shared memory refer
    to it too; it closes with the last reference."""

    daemon: Any = None

    def __del__(self) -> None:
        self.close()


class Link:
    """A channel and the session opened over it. Belongs to the process that opened it."""

    def __init__(self, access: Access, resume: int = 0, deadline: Deadline | None = None) -> None:
        path = access.socket
        self.pid = os.getpid()
        self._deadline = deadline or Deadline(RETRY_SECONDS)
        self._access = access
        self._resume = resume  # the session of before the daemon was restarted
        self._calls: dict[tuple[str, bool], Any] = {}
        self._session: tuple[tuple[str, str], ...] = ()
        self._local_channel: LocalChannel | None = None
        self.quick: FastPathConnection | None = None
        self._keep: Any = None
        self._keeper: threading.Thread | None = None
        self.channel = access.channel()
        try:
            self._begin(path)
            self._share()
        except BaseException:
            self.close()
            raise
        if not path:
            self.keep_session()

    def _begin(self, path: str) -> None:
        """A ticket that is not known is of a daemon that ended before it was used: the next one has
        another."""
        patience = Patience(self._deadline.left())
        while True:
            ticket = self._connect_local_channel(path + ".fd.sock") if path else b""
            try:
                return self._open_session(ticket)
            except grpc.RpcError as error:
                if to_error(error).field != "ticket" or not patience.wait():
                    raise

    def _share(self) -> None:
        """Sets up the other uses of the local channel: shared buffers and quick calls."""
        self.shared = share_frames(self._local_channel, self.server.capabilities)
        self.quick = open_fast_path(self._local_channel, self.server.capabilities)
        if self._local_channel is not None:
            self._local_channel.settimeout(RETRY_SECONDS)

    def _connect_local_channel(self, path: str) -> bytes:
        """Connects the socket that keeps the session alive. Returns the one-time ticket."""
        if not hasattr(socket, "AF_UNIX"):
            raise Unavailable("unix: addresses are for Linux; connect to host:port")
        local_channel = LocalChannel(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            local_channel.settimeout(self._deadline.left())
            local_channel.connect(path)
            ticket = local_channel.recv(4096)
        except TimeoutError:
            local_channel.close()
            raise self._silent(path) from None
        except OSError as error:
            local_channel.close()
            raise Unavailable(_unreachable(path, error)) from None
        if len(ticket) != _TICKET_BYTES:
            local_channel.close()
            raise Unavailable(f"{path} gave no ticket; is it a heliographd socket of this version?")
        if self._local_channel:
            self._local_channel.close()
        self._local_channel = local_channel
        return ticket

    def _open_session(self, ticket: bytes) -> None:
        client = f"python {platform.python_version()} heliograph {__version__}"
        request = service.OpenSessionRequest(client=client, ticket=ticket, resume=self._resume)
        call, metadata = self.method("OpenSession"), self.metadata
        left = self._deadline.left()
        rest = min(1.0, left / 5)
        try:
            reply = call(request, timeout=left - rest, metadata=metadata, wait_for_ready=True)
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.DEADLINE_EXCEEDED:
                raise
            reply = self._ask_again(request, rest)
        self.session = int(reply.session)
        self.server: service.GetServerInfoReply = reply.server
        self.averaged = {kind.plane: kind.averaged for kind in self.server.planes}
        _check_api(self.server)
        self._session = (("heliograph-session", str(self.session)),)

    def _ask_again(self, request: service.OpenSessionRequest, seconds: float) -> Any:
        """Opens the session without waiting for a connection, so that an error names the cause."""
        call = self.method("OpenSession")
        try:
            return call(request, timeout=seconds, metadata=self.metadata)
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.DEADLINE_EXCEEDED:
                raise
            raise self._silent(self._access.address) from None

    def _silent(self, where: str) -> Unavailable:
        return Unavailable(
            f"{where} gave no answer within {self._deadline.seconds:g} s: check that a heliographd "
            "of this version listens there and is not stuck, or raise timeout= of connect()"
        )

    def keep(self, daemon: Any) -> None:
        """Keeps a private daemon alive as long as objects refer to the session."""
        if self._local_channel is not None:
            self._local_channel.daemon = daemon

    def ask_quickly(
        self, call: service.QuickCall, on_progress: Callable[[Any], None] | None = None
    ) -> service.QuickReply | None:
        """Sends an Apply or Render by the fast path; raises its refusal. None: ask by gRPC, which
        resumes sessions, and waits before it repeats what may be done once only."""
        if self.quick is None or self._access.traced():  # a packet has no room for a trace
            return None
        call.token = self._access.bearer()
        reply = self.quick.ask(call, on_progress)
        if reply is None or not reply.HasField("status"):
            return reply
        waits = call.HasField("apply") and reply.status.code == _UNAVAILABLE
        if waits or reply.status.code == _UNAUTHENTICATED:
            return None
        raise status_error(reply.status)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """Headers of each call: token, trace, session."""
        return self._access.metadata() + self._session

    def keep_session(self) -> None:
        """Over TCP a stream carries the session; a thread reads it."""
        self._keep = self.method("KeepSession")(
            service.KeepSessionRequest(), metadata=self.metadata
        )
        self._keeper = threading.Thread(target=_drain, args=(self._keep,), daemon=True)
        self._keeper.start()

    def pause_for_fork(self) -> None:
        """Closes the open stream before os.fork, which allows none; the grace time bridges the
        gap."""
        if self.shared is not None:
            self.shared.keep_leases()
        if self._keep is not None:
            self._keep.cancel()
            if self._keeper:
                self._keeper.join(1)
            time.sleep(0.02)

    def resume_after_fork(self) -> None:
        if self._keep is not None:
            self.keep_session()

    def method(self, name: str, raw: bool = False) -> Any:
        """The callable of an RPC; `raw`: replies stay bytes."""
        key = (name, raw)
        if key not in self._calls:
            found = _METHODS[name]
            kind = ("stream" if found.client_streaming else "unary") + (
                "_stream" if found.server_streaming else "_unary"
            )
            reply = message_factory.GetMessageClass(found.output_type)
            self._calls[key] = getattr(self.channel, kind)(
                f"/{found.containing_service.full_name}/{name}",
                request_serializer=_serialize,
                response_deserializer=None if raw else reply.FromString,
            )
        return self._calls[key]

    def abandon(self) -> None:
        """Leaves the parent's channel alone for ever, in a forked child, and closes our copy of the
        local channel. Closing or freeing the channel here would hang, so it is made immortal."""
        for thing in (self.channel, self._calls, self._keep):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
        if self.quick is not None:
            self.quick.close()
        if self._local_channel:
            self._local_channel.close()

    def __del__(self) -> None:
        """Nobody refers to the session: it ends. Over a Unix socket the local channel does that."""
        keep = getattr(self, "_keep", None)
        if keep is not None and self.pid == os.getpid():
            keep.cancel()

    def close(self) -> None:
        if self._keep is not None:
            self._keep.cancel()
        if self.quick is not None:
            self.quick.end()
        if self._local_channel:
            self._local_channel.close()
        self.channel.close()


def _unreachable(path: str, error: OSError) -> str:
    if error.errno is None:  # of Python, which did not try it
        return (
            f"{path} is too long for the path of a socket ({error}): make a symbolic link to its "
            "folder and connect through that"
        )
    return f"no daemon listens at {path}: {error}; start one there, or correct the address"


def _serialize(message: Any) -> bytes:
    return bytes(message.SerializeToString())


def _drain(stream: Any) -> None:
    with contextlib.suppress(grpc.RpcError):
        for _ in stream:
            pass
