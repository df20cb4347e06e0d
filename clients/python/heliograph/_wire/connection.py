"""The calls of one client over its session: retries, resumption, fork. Used by client.py."""

from __future__ import annotations

import contextlib
import os
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

import grpc

from ..errors import HeliographError, NotFound, Unauthenticated, Unavailable
from ._proto import service_pb2 as service
from .access import Access
from .link import Link, Patience
from .quick import QUICK_BYTES
from .status import to_error

if TYPE_CHECKING:
    from .launch import PrivateDaemon
    from .start import Deadline


_NO_JOURNAL = service.GetServerInfoReply.JOURNAL_NONE


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

    def open(self, deadline: Deadline | None) -> None:
        """Opens the session now, so that connect() fails rather than the first call."""
        with self._lock:
            self._link = self._open_link(deadline)

    def _open_link(self, deadline: Deadline | None = None) -> Link:
        try:
            link = Link(self.access, deadline=deadline)
        except (grpc.RpcError, Unavailable) as error:
            raise self._with_end(_typed(error)) from None
        link.keep(self.daemon)
        return link

    def resume(self, link: Link, failure: HeliographError) -> bool:
        """True if the daemon was restarted and opened the session again: with the numbering of the
        edits of durable scenes, without anything else."""
        if not isinstance(failure, Unauthenticated) or link.server.journal == _NO_JOURNAL:
            return False
        with self._lock:
            if self._link is not link:
                return self._link is not None  # another thread was here
            self._link = self._resumed(link.session)  # None: the next call opens a new session
        link.close()
        return self._link is not None

    def _resumed(self, session: int) -> Link | None:
        """Opens the same session, trying again while the daemon is unavailable; None: it is gone.
        It may be open already, because the answer was lost: without a link it would end."""
        patience = Patience()
        while True:
            try:
                return Link(self.access, session)
            except (grpc.RpcError, Unavailable) as error:
                failure = _typed(error)
            if isinstance(failure, NotFound):
                return None
            if not isinstance(failure, Unavailable) or self.closed or not patience.wait():
                raise failure

    def _with_end(self, error: HeliographError) -> HeliographError:
        """Error that describes how the private daemon died, if it did; otherwise `error`."""
        if isinstance(error, Unavailable) and self.daemon is not None:
            deadline = time.monotonic() + 0.3
            while self.daemon.exit_code() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            if self.daemon.exit_code() is not None:
                return self.daemon.death("heliographd died")
        return error

    def apply(self, request: service.ApplyRequest) -> service.ApplyReply:
        """Apply, by the shortest way."""
        reply = None
        if request.ByteSize() < QUICK_BYTES:
            reply = self.link.ask_quickly(service.QuickCall(apply=request))
        return self.call("Apply", request) if reply is None else reply.apply

    def call(self, name: str, request: Any, timeout: float | None = None) -> Any:
        """A unary call, repeated while the daemon is unavailable: edits are numbered and creations
        carry a request id, so that a repetition is answered, not done twice."""

        def ask(link: Link) -> Any:
            return link.method(name)(request, timeout=timeout, metadata=link.metadata)

        return self._repeat(ask, timeout)

    def call_all(self, name: str, request: Any) -> list[Any]:
        """The replies of a server stream that changes nothing, repeated likewise."""
        return list(
            self._repeat(lambda link: list(link.method(name)(request, metadata=link.metadata)))
        )

    def _repeat(self, ask: Callable[[Link], Any], timeout: float | None = None) -> Any:
        patience = Patience(timeout)
        while True:
            link = self.link
            try:
                return ask(link)
            except grpc.RpcError as error:
                failure = to_error(error)
            if self.resume(link, failure):
                patience = Patience(timeout)  # the daemon is back, for however long
                continue
            if not isinstance(failure, Unavailable):
                raise failure
            failure = self._with_end(failure)
            is_dead = self.daemon is not None and self.daemon.exit_code() is not None
            if is_dead or not patience.wait():
                raise failure

    def stream(
        self, name: str, request: Any, raw: bool = False, timeout: float | None = None
    ) -> Stream:
        """The replies to a request, or to an iterator of requests."""

        def begin() -> tuple[Link, Any]:
            link = self.link
            call = link.method(name, raw)(request, timeout=timeout, metadata=link.metadata)
            return link, call

        return Stream(self, begin, name in _REPEATED)

    def push(self, name: str, requests: Iterable[Any]) -> Any:
        """Sends a client stream and returns its reply. Raises the errors of `requests`, too."""
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
        """Error to raise for a call that cannot be repeated here."""
        failed = to_error(error)
        if self.closed and isinstance(failed, Unavailable):
            return Unavailable("this client was closed in the middle of the call")
        if self.resume(link, failed):
            return Unavailable(
                "the daemon was restarted, and the session goes on: ask again; anything "
                "that was not durable is gone"
            )
        return self._with_end(failed)

    def close(self) -> None:
        """Ends the session, and a private daemon. Safe to call twice."""
        with self._lock:
            link, self._link, closed, self.closed = self._link, None, self.closed, True
        if link is not None and link.pid == os.getpid():
            # Should it fail: the end of the local channel, next line, frees the same things.
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
        """Replaces the lock and leaves the parent's link alone, in a forked child."""
        self._lock = threading.Lock()
        link, self._link = self._link, None
        if link is not None:
            link.abandon()


def _typed(error: grpc.RpcError | Unavailable) -> HeliographError:
    return error if isinstance(error, HeliographError) else to_error(error)


class Stream:
    """Messages of a server stream; cancels it when left early. A call that `repeats` is sent again
    if the daemon refused it because it was restarted."""

    def __init__(
        self, connection: Connection, begin: Callable[[], tuple[Link, Any]], repeats: bool
    ) -> None:
        self._connection = connection
        self._begin = begin
        self._repeats = repeats
        self._cancelled = False
        self.link, self._call = begin()

    def cancel(self) -> None:
        """Cancels the call. Thread: any."""
        self._cancelled = True
        self._call.cancel()

    def __iter__(self) -> Iterator[Any]:
        try:
            try:
                yield from self._call
            except grpc.RpcError as error:
                restarted = self._asked_again(error)
                try:
                    yield from self._call
                except grpc.RpcError as second:
                    failure = self._connection.failure(self.link, second)
                    raise (restarted if isinstance(failure, NotFound) else failure) from None
        finally:
            self._call.cancel()

    def _asked_again(self, error: grpc.RpcError) -> HeliographError:
        """Begins the call again, or raises its error. Returns the error to raise if the call names
        something that was not durable."""
        failure = self._connection.failure(self.link, error)
        refused = error.code() == grpc.StatusCode.UNAUTHENTICATED  # so it had not begun
        if not (refused and self._repeats and isinstance(failure, Unavailable)):
            raise failure from None
        self.link, self._call = self._begin()
        if self._cancelled:
            self._call.cancel()
        return failure


_REPEATED = {"Render", "Read", "ExportScene"}  # they change nothing and take nothing up

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
