"""One session with a daemon: channel, lifeline, typed errors, retries, fork. Used by client.py."""

from __future__ import annotations

import array
import contextlib
import ctypes
import os
import platform
import socket
import threading
import time
import weakref
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import grpc
from google.protobuf import message_factory

from ._proto import service_pb2 as service
from ._shared import share_frames
from ._status import to_error
from .access import Access
from .errors import FailedPrecondition, HeliographError, NotFound, Unauthenticated, Unavailable

if TYPE_CHECKING:
    from ._launch import PrivateDaemon

API = 1  # the version of the contract, heliograph.vN, that this client speaks
RETRY_SECONDS = 10.0  # how long an unreachable daemon is tried again
_METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name
_TICKET_BYTES = 16


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


class Link:
    """A channel and the session opened over it. Belongs to the process that opened it."""

    def __init__(self, access: Access, resume: int = 0) -> None:
        path = access.socket
        self.pid = os.getpid()
        self._access = access
        self._resume = resume  # the session of before the daemon was restarted
        self._calls: dict[tuple[str, bool], Any] = {}
        self._session: tuple[tuple[str, str], ...] = ()
        self._lifeline: socket.socket | None = None
        self._keep: Any = None
        self._keeper: threading.Thread | None = None
        ticket = self._connect_lifeline(path + ".fd.sock") if path else b""
        self.channel = access.channel()
        try:
            self._open_session(ticket)
        except BaseException:
            self.close()
            raise
        self.shared = share_frames(self._lifeline, self.server.capabilities)
        if not path:
            self.keep_session()

    def _connect_lifeline(self, path: str) -> bytes:
        """The second socket: the session lives as long as it does. Returns the one-time ticket."""
        if not hasattr(socket, "AF_UNIX"):
            raise Unavailable("unix: addresses are for Linux; connect to host:port")
        lifeline = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            lifeline.settimeout(RETRY_SECONDS)
            lifeline.connect(path)
            ticket = lifeline.recv(4096)
        except OSError as error:
            lifeline.close()
            raise Unavailable(f"no daemon listens at {path}: {error}") from None
        if len(ticket) != _TICKET_BYTES:
            lifeline.close()
            raise Unavailable(f"{path} gave no ticket; is it a heliographd socket of this version?")
        self._lifeline = lifeline
        return ticket

    def _open_session(self, ticket: bytes) -> None:
        from . import __version__

        client = f"python {platform.python_version()} heliograph {__version__}"
        request = service.OpenSessionRequest(client=client, ticket=ticket, resume=self._resume)
        call, metadata = self.method("OpenSession"), self.metadata
        try:
            reply = call(request, timeout=RETRY_SECONDS, metadata=metadata, wait_for_ready=True)
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.DEADLINE_EXCEEDED:
                raise
            reply = call(request, timeout=1, metadata=metadata)  # its error names the cause
        self.session = int(reply.session)
        self.server: service.GetServerInfoReply = reply.server
        _check_api(self.server)
        self._session = (("heliograph-session", str(self.session)),)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """What each call carries."""
        return self._access.metadata() + self._session

    def keep_session(self) -> None:
        """Over TCP a stream carries the session; a thread reads it."""
        self._keep = self.method("KeepSession")(
            service.KeepSessionRequest(), metadata=self.metadata
        )
        self._keeper = threading.Thread(target=_drain, args=(self._keep,), daemon=True)
        self._keeper.start()

    def pause_for_fork(self) -> None:
        """No stream may be open at os.fork; the grace time bridges the gap."""
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
        """In a forked child: leaves the parent's channel alone for ever, closes our copy of the
        lifeline. Closing or freeing the channel here would hang, so it is made immortal."""
        for thing in (self.channel, self._calls, self._keep):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
        if self._lifeline:
            self._lifeline.close()

    def close(self) -> None:
        if self._keep is not None:
            self._keep.cancel()
        if self._lifeline:
            self._lifeline.close()
        self.channel.close()


def _serialize(message: Any) -> bytes:
    return bytes(message.SerializeToString())


def _drain(stream: Any) -> None:
    with contextlib.suppress(grpc.RpcError):
        for _ in stream:
            pass


class Connection:
    """Calls of one client. Opens a session when first used, and again in a forked child.

    Thread: any.
    """

    def __init__(self, access: Access, daemon: PrivateDaemon | None) -> None:
        self.access = access
        self.daemon = daemon
        self.closed = False
        self._lock = threading.Lock()
        self._link: Link | None = None
        _connections.add(self)

    @property
    def link(self) -> Link:
        """The session of this process."""
        link = self._link
        if link is not None and link.pid == os.getpid():
            return link
        with self._lock:
            if self.closed:
                raise Unavailable("this client is closed; connect() again")
            if self._link is None:
                self._link = self._open_link()
            return self._link

    def open(self) -> None:
        """Opens the session now, so that connect() fails rather than the first call."""
        assert self.link

    def _open_link(self) -> Link:
        try:
            return Link(self.access)
        except grpc.RpcError as error:
            raise self._lost(to_error(error)) from None
        except Unavailable as error:
            raise self._lost(error) from None

    def resume(self, link: Link, failure: HeliographError) -> bool:
        """Whether the daemon was restarted and opened the session again: with the numbering of the
        edits of durable scenes, without anything else."""
        if not isinstance(failure, Unauthenticated) or not link.server.journal:
            return False
        with self._lock:
            if self._link is not link:
                return self._link is not None  # another thread was here
            self._link = self._resumed(link.session)  # None: the next call opens a new session
        link.close()
        return self._link is not None

    def _resumed(self, session: int) -> Link | None:
        """The same session, tried again while the daemon is unavailable; None: it is gone. It may
        be open, because the answer was lost: without a link it would end."""
        patience = Patience()
        while True:
            try:
                return Link(self.access, session)
            except (grpc.RpcError, Unavailable) as error:
                failure = error if isinstance(error, HeliographError) else to_error(error)
            if isinstance(failure, NotFound):
                return None
            # A ticket that is not known is of a daemon that ended before it was used.
            may_come = isinstance(failure, Unavailable) or failure.field == "ticket"
            if not may_come or self.closed or not patience.wait():
                raise failure

    def _lost(self, error: HeliographError) -> HeliographError:
        """How the private daemon died, when that is why."""
        if isinstance(error, Unavailable) and self.daemon is not None:
            deadline = time.monotonic() + 0.3
            while self.daemon.exit_code() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            if self.daemon.exit_code() is not None:
                return self.daemon.death("heliographd died")
        return error

    def call(self, name: str, request: Any, timeout: float | None = None) -> Any:
        """A unary call, repeated while the daemon is unavailable: edits are numbered and creations
        carry a request id, so that a repetition is answered, not done twice."""
        patience = Patience(timeout)
        while True:
            link = self.link
            try:
                return link.method(name)(request, timeout=timeout, metadata=link.metadata)
            except grpc.RpcError as error:
                failure = to_error(error)
            if self.resume(link, failure):
                patience = Patience(timeout)  # the daemon is back, for however long
                continue
            if not isinstance(failure, Unavailable):
                raise failure
            failure = self._lost(failure)
            is_dead = self.daemon is not None and self.daemon.exit_code() is not None
            if is_dead or not patience.wait():
                raise failure

    def stream(
        self, name: str, request: Any, raw: bool = False, timeout: float | None = None
    ) -> Stream:
        """The replies to a request, or to an iterator of requests."""
        link = self.link
        found = link.method(name, raw)(request, timeout=timeout, metadata=link.metadata)
        return Stream(self, link, found)

    def push(self, name: str, requests: Iterable[Any]) -> Any:
        """A client stream; its reply. What `requests` raises is raised here."""
        link = self.link
        faults: list[Exception] = []

        def guarded() -> Iterator[Any]:
            try:
                yield from requests
            except Exception as fault:
                faults.append(fault)
                raise

        try:
            return link.method(name)(guarded(), metadata=link.metadata)
        except grpc.RpcError as error:
            if faults:
                raise faults[0] from None
            raise self.failure(link, error) from None

    def failure(self, link: Link, error: grpc.RpcError) -> HeliographError:
        """What to raise for a call that cannot be repeated here."""
        failed = to_error(error)
        if self.closed and isinstance(failed, Unavailable):
            return Unavailable("this client was closed in the middle of the call")
        if self.resume(link, failed):
            return Unavailable(
                "the daemon was restarted, and the session goes on: ask again; what was not "
                "durable is gone"
            )
        return self._lost(failed)

    def close(self) -> None:
        """Ends the session, and a private daemon. Safe to call twice."""
        with self._lock:
            link, self._link, closed, self.closed = self._link, None, self.closed, True
        if link is not None and link.pid == os.getpid():
            # Should it fail: the end of the lifeline, next line, frees the same things.
            with contextlib.suppress(grpc.RpcError):
                link.method("CloseSession")(
                    service.CloseSessionRequest(), timeout=2, metadata=link.metadata
                )
            link.close()
        if self.daemon is not None and not closed:
            self.daemon.stop()

    def pause_for_fork(self) -> None:
        if self._link is not None:
            self._link.pause_for_fork()

    def resume_after_fork(self) -> None:
        if self._link is not None:
            self._link.resume_after_fork()

    def forget_parent(self) -> None:
        """In a forked child."""
        self._lock = threading.Lock()
        link, self._link = self._link, None
        if link is not None:
            link.abandon()


class Stream:
    """Messages of a server stream; cancels it when left early."""

    def __init__(self, connection: Connection, link: Link, call: Any) -> None:
        self._connection = connection
        self._link = link
        self._call = call

    def cancel(self) -> None:
        """From any thread."""
        self._call.cancel()

    def __iter__(self) -> Iterator[Any]:
        try:
            yield from self._call
        except grpc.RpcError as error:
            raise self._connection.failure(self._link, error) from None
        finally:
            self._call.cancel()


def packed_ids(data: bytes) -> list[int]:
    """ApplyReply.ids."""
    numbers = array.array("Q")
    numbers.frombytes(data)
    return list(numbers)


_connections: weakref.WeakSet[Connection] = weakref.WeakSet()


def _before_fork() -> None:
    for connection in list(_connections):
        connection.pause_for_fork()


def _in_parent() -> None:
    for connection in list(_connections):
        connection.resume_after_fork()


def _in_child() -> None:
    for connection in list(_connections):
        connection.forget_parent()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_in_parent, after_in_child=_in_child)
