"""Recorded questions asked again: Read, Query, Tracks, DescribeScene, ExportScene and Watch.

Used by replay.py.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

import grpc
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire.status import status_error, to_error

from ._answers import difference_of
from ._calls import Calls, Differs, NotPlayed
from .reader import Call, Recording

QUESTIONS = ("Read", "Query", "Tracks", "DescribeScene", "ExportScene")  # and Watch
_PATIENCE = 10.0  # seconds for the next message of a Watch
_BOOKMARK = 0.5  # seconds, the shortest: after these it is known that a change is missing
_METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name


class Questions:
    """Questions of a recording. An answer is a message, or the HeliographError that ended the
    call."""

    def __init__(self, recording: Recording, calls: Calls) -> None:
        self._recording = recording
        self._calls = calls
        self._watches: dict[int, _Watch] = {}  # by call

    def close(self) -> None:
        for watch in self._watches.values():
            watch.close()

    def ask(self, call: Call) -> None:
        """The question, and all its answers."""
        assert call.status is not None
        status = call.status.item
        recorded: list[Any] = [self._recording.reply(call, part) for part in call.replies]
        end = status_error(status.status) if status.status.code else None
        if end is not None:
            recorded.append(end)
        request = self._recording.request(call, call.requests[0])
        name = self._calls.name_of(request.scene)
        answers = _Answers(self._calls.link(call), call.method, self._for_here(call, end))
        try:
            for was, found in zip_longest(recorded, answers):
                if difference := difference_of(was, found):
                    which = _which(request, was)
                    raise Differs(f"{name}, revision {status.revision}: {which}{difference}")
        finally:
            answers.close()

    def begin(self, call: Call) -> None:
        """Begins a Watch where it began; keeps its answers until they are compared."""
        first = self._recording.reply(call, call.replies[0])
        request = self._for_here(call, None)
        request.from_revision = first.revision + 1
        request.bookmark_seconds = _BOOKMARK
        watch = _Watch(_Answers(self._calls.link(call), call.method, request))
        self._watches[call.number] = watch
        self._compare_reply(call, first, watch.next())

    def compare_changes(self, call: Call) -> None:
        """Compares the transactions of a Watch. NotPlayed where it did not begin."""
        watch = self._watches.pop(call.number, None)
        if watch is None:
            raise NotPlayed("it did not begin")
        try:
            for part in call.replies:
                was = self._recording.reply(call, part)
                if was.HasField("transaction"):
                    self._compare_reply(call, was, watch.next_change())
        finally:
            watch.close()

    def _compare_reply(self, call: Call, was: service.WatchReply, found: Any) -> None:
        if difference := difference_of(was, found):
            name = self._calls.name_of(self._recording.request(call, call.requests[0]).scene)
            raise Differs(f"{name}, revision {was.revision}: {difference}")

    def _for_here(self, call: Call, was: Any) -> Any:
        request = self._recording.request(call, call.requests[0])
        return self._calls.for_here(call, request, was)


class _Answers:
    """A call's messages, then the HeliographError that ended it, if one did. close(): from any
    thread.
    """

    def __init__(self, link: Any, method: str, request: Any) -> None:
        self._asked: Any = None
        self._stream: Any = None
        ask = link.method(method)
        if _METHODS[method].server_streaming:
            self._stream = ask(request, metadata=link.metadata)
        else:
            self._asked = lambda: ask(request, metadata=link.metadata)

    def __iter__(self) -> Iterator[Any]:
        try:
            if self._stream is not None:
                yield from self._stream
            else:
                yield self._asked()
        except grpc.RpcError as error:
            yield to_error(error)

    def close(self) -> None:
        if self._stream is not None:
            self._stream.cancel()


class _Watch:
    """Reads a Watch as its replies come, so that the daemon need not wait."""

    def __init__(self, answers: _Answers) -> None:
        self._answers = answers
        self._read: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        for answer in self._answers:
            self._read.put(answer)

    def next(self) -> Any:
        """The next answer; None: none came."""
        try:
            return self._read.get(timeout=_PATIENCE)
        except queue.Empty:
            return None

    def next_change(self) -> Any:
        """The next one that is no bookmark; None: there is none."""
        idle = 0  # bookmarks since all was read; one may have been on its way
        while idle < 2:
            is_all_read = self._read.empty()
            answer = self.next()
            if not isinstance(answer, service.WatchReply) or answer.HasField("transaction"):
                return answer
            idle += is_all_read
        return None

    def close(self) -> None:
        self._answers.close()


def _which(request: Any, answer: Any) -> str:
    """Field and object that an answer of a Read describes, as "field of name: "; "" for other
    answers."""
    if not isinstance(answer, service.ReadReply):
        return ""
    if answer.ref >= max(1, len(request.refs)) or answer.field >= len(request.fields):
        return ""
    ref = request.refs[answer.ref] if request.refs else None
    of = f" of {ref.name or ref.id!r}" if ref is not None else ""
    return f"{request.fields[answer.field]}{of}: "
