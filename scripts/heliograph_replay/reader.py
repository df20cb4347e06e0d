"""Reads a recording (heliographd --record), in the format of recording.proto. Used by replay.py."""

from __future__ import annotations

import hashlib
import mmap
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from google.protobuf import message_factory
from google.protobuf.message import DecodeError
from heliograph._wire._proto import recording_pb2 as pb
from heliograph._wire._proto import service_pb2 as service
from heliograph.errors import InvalidArgument

FORMAT, VERSION = "heliograph.recording", 2
_METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name


class Damaged(Exception):
    """Damaged part of a recording; the message names it."""


@dataclass(frozen=True)
class Part:
    """Something of a call. at: its place in the order of the recording."""

    at: int
    item: Any  # RecordReply, RecordFrame, RecordStatus; of a request: (offset, size) in the file


@dataclass
class Call:
    """A recorded call."""

    number: int
    session: int
    method: str
    at: int
    requests: list[Part] = field(default_factory=list)
    replies: list[Part] = field(default_factory=list)
    frames: list[Part] = field(default_factory=list)
    status: Part | None = None  # None: it did not end within the recording

    @property
    def end(self) -> int:
        """Its place when it ended."""
        return self.status.at if self.status else self.at

    def __str__(self) -> str:
        return f"call {self.number} {self.method}"


class Recording:
    """A file, its calls by number. Requests and bytes are read when they are needed.

    calls, sessions, buffers: by number; of buffers by (session, buffer).
    ends: (place, session) of sessions that ended. reason: why the recording ends; "": it was cut
    short.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.header = pb.RecordHeader()
        self.calls: dict[int, Call] = {}
        self.sessions: dict[int, pb.RecordSession] = {}
        self.ends: list[tuple[int, int]] = []
        self.buffers: dict[tuple[int, int], list[bytes]] = {}
        self.reason = ""
        self._bytes: dict[bytes, tuple[int, int]] = {}
        with open(self.path, "rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise InvalidArgument(f"{self.path} is empty", field="file")
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._load()

    def _load(self) -> None:
        last = ""
        for at, (offset, size) in enumerate(self._items()):
            item = pb.RecordItem()
            try:
                item.ParseFromString(self._data[offset : offset + size])
                kind = item.WhichOneof("item")
                if at == 0:
                    self._check_header(item)
                elif kind is not None:  # None: of a later version
                    self._take(at, kind, getattr(item, kind), (offset, size))
            except (DecodeError, KeyError):
                where = f"at byte {offset}{', after ' + last if last else ''}"
                raise InvalidArgument(f"{self.path} is damaged {where}", field="file") from None
            if kind in ("call", "request", "reply", "frame", "status"):
                last = str(self.calls[getattr(item, kind).call])
        if not self.header.format:
            raise InvalidArgument(f"{self.path} is no recording", field="file")

    def _items(self) -> Iterator[tuple[int, int]]:
        """(offset, size) of each whole item."""
        at, end = 0, len(self._data)
        while at < end:
            size = shift = 0
            while at < end:
                byte = self._data[at]
                at += 1
                size |= (byte & 0x7F) << shift
                shift += 7
                if byte < 0x80:
                    break
            else:
                return
            if at + size > end:
                return
            yield at, size
            at += size

    def _check_header(self, item: pb.RecordItem) -> None:
        self.header.CopyFrom(item.header)
        if self.header.format != FORMAT:
            raise InvalidArgument(f"{self.path} is no recording", field="file")
        if self.header.version != VERSION:
            raise InvalidArgument(
                f"{self.path} is of version {self.header.version}; this client reads {VERSION}",
                field="file",
            )

    def _take(self, at: int, kind: str, item: Any, place: tuple[int, int]) -> None:
        if kind == "session":
            self.sessions[item.session] = item
        elif kind == "session_end":
            self.ends.append((at, item.session))
        elif kind == "bytes":
            self._bytes[item.sha256] = place
        elif kind == "buffer":
            self.buffers[item.session, item.buffer] = list(item.sha256)
        elif kind == "call":
            _ = self.sessions[item.session]
            self.calls[item.call] = Call(item.call, item.session, item.method, at)
        elif kind == "request":
            self.calls[item.call].requests.append(Part(at, place))
        elif kind == "reply":
            self.calls[item.call].replies.append(Part(at, item))
        elif kind == "frame":
            self.calls[item.call].frames.append(Part(at, item))
        elif kind == "status":
            self.calls[item.call].status = Part(at, item)
        elif kind == "end":
            self.reason = item.reason

    def request(self, call: Call, part: Part) -> Any:
        """A request message, whole."""
        offset, size = part.item
        item = pb.RecordItem.FromString(self._data[offset : offset + size]).request
        message = _message(_METHODS[call.method].input_type, item.message)
        if item.sha256:
            message.chunk = self.bytes(item.sha256)
        return message

    def reply(self, call: Call, part: Part) -> Any:
        """A reply message; of a question with hashes in the place of long bytes."""
        data = self.bytes(part.item.sha256) if part.item.sha256 else part.item.message
        return _message(_METHODS[call.method].output_type, data)

    def bytes(self, sha256: bytes) -> bytes:
        """The bytes that an item names."""
        if sha256 not in self._bytes:
            raise Damaged("its bytes are not in the recording")
        offset, size = self._bytes[sha256]
        data = pb.RecordItem.FromString(self._data[offset : offset + size]).bytes.data
        if hashlib.sha256(data).digest() != sha256:
            raise Damaged("its bytes are damaged")
        return bytes(data)

    def tenants(self) -> list[str]:
        """Their names."""
        return sorted({session.tenant for session in self.sessions.values()})


def _message(kind: Any, data: bytes) -> Any:
    try:
        return message_factory.GetMessageClass(kind).FromString(data)
    except DecodeError:
        raise Damaged("its message is damaged") from None
