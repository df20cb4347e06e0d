"""Replay of one recorded call, and the comparison of its answer. Used by replay.py."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator
from typing import Any

import grpc
from google.protobuf.json_format import ParseDict, ParseError
from google.protobuf.message import Message
from heliograph._wire._proto import recording_pb2 as pb
from heliograph._wire._proto import render_pb2
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire._proto import types_pb2 as types
from heliograph._wire.status import status_error, to_error
from heliograph.client.client import Client, open_client
from heliograph.errors import HeliographError
from heliograph.render._assembly import Assembly
from heliograph.render.frame import Rendered

from .reader import Call, Damaged, Part, Recording

_METHODS = service.DESCRIPTOR.services_by_name["Renderer"].methods_by_name
_NO_SCENE = 2**64 - 1
_BEFORE = (
    "its scene was there before the recording began, which does not hold it; to have it played, "
    "save it, and load it while the daemon records"
)
COMPARED = {  # fields of replies
    "CreateScene": ("revision", "lifetime", "name"),
    "BranchScene": ("revision", "lifetime", "name"),
    "ImportScene": ("revision", "lifetime", "name"),
    "OpenScene": ("lifetime", "name"),
    "DeleteScene": (),
    "Apply": ("revision", "ids", "counts"),
    "UploadBlob": ("size",),
    "DecodeAsset": ("missing", "asset"),
}


class Differs(Exception):
    """The answer is another one; the message has the difference."""


class NotPlayed(Exception):
    """The call was left out; the message has the reason."""


class Calls:
    """The sessions of a recording at a daemon, and how its scenes are numbered there."""

    def __init__(self, recording: Recording, client: Client) -> None:
        self._recording = recording
        self._client = client
        self._sessions: dict[int, Client] = {}
        self._scenes: dict[int, int] = {}  # recorded number: the daemon's
        self._names: dict[int, str] = {}  # by recorded number
        self._blobs = dict(self._find_blobs())

    def close(self) -> None:
        for session in list(self._sessions):
            self.end(session)

    def end(self, session: int) -> None:
        """The session ended here."""
        client = self._sessions.pop(session, None)
        if client is not None:
            client.close()

    def _find_blobs(self) -> Iterator[tuple[bytes, Call]]:
        """The uploads that brought a blob whole, by its hash."""
        for call in self._recording.calls.values():
            if call.method != "UploadBlob" or call.status is None or call.status.item.status.code:
                continue
            if not call.replies or not call.requests:
                continue
            with contextlib.suppress(Damaged):  # reported when it is played
                if not self._recording.reply(call, call.replies[0]).existed:
                    yield self._recording.request(call, call.requests[0]).sha256, call

    # ------------------------------------------------------------ asking

    def link(self, call: Call) -> Any:
        if call.session not in self._sessions:
            access = self._client.connection.access
            self._sessions[call.session] = open_client(access, None)
        return self._sessions[call.session].connection.link

    def _ask(self, call: Call, method: str, requests: Iterable[Any]) -> Any:
        """The reply, or the HeliographError that came instead."""
        link = self.link(call)
        kind = _METHODS[method]
        argument = iter(requests) if kind.client_streaming else next(iter(requests))
        try:
            reply = link.method(method)(argument, metadata=link.metadata)
            return merged(reply) if kind.server_streaming else reply
        except grpc.RpcError as error:
            return to_error(error)

    def name_of(self, scene: int) -> str:
        """A recorded scene, for people."""
        return f"scene {self._names.get(scene, '') or scene!r}"

    def for_here(self, call: Call, request: Any, was: Any) -> Any:
        """A request with the scene's number at this daemon and without shared buffers. was: the
        reply, or its HeliographError.
        """
        if "scene" in request.DESCRIPTOR.fields_by_name:
            if request.scene not in self._scenes and key_of(was) != ("NOT_FOUND", "scene"):
                raise NotPlayed(_BEFORE)
            request.scene = self._scenes.get(request.scene, _NO_SCENE)
        if any(session == call.session for session, _ in self._recording.buffers):
            for array in arrays_of(request):
                if array.HasField("buffer"):
                    self._upload_buffer(call, array)
        return request

    def _upload_buffer(self, call: Call, array: types.Array) -> None:
        """Gives an array's bytes, which were in a shared buffer, as an upload."""
        place = array.buffer
        pieces = self._recording.buffers.get((call.session, place.buffer))
        if pieces is None:
            return
        data = b"".join(self._recording.bytes(piece) for piece in pieces)
        if place.offset % 64 or place.offset + place.size > len(data):
            raise NotPlayed("it names bytes outside its shared buffer")
        data = data[place.offset : place.offset + place.size]
        name = f"buffer {place.buffer} of call {call.number}"
        first = service.UploadBlobRequest(request_id=name, size=len(data))
        sent = self._ask(call, "UploadBlob", _pieces(first, data, self._chunk_bytes(call)))
        if isinstance(sent, HeliographError):
            raise sent
        array.upload = name

    def _chunk_bytes(self, call: Call) -> int:
        return int(self.link(call).server.limits["chunk_bytes"])

    # ------------------------------------------------------------ planning

    def scene_of(self, call: Call, part: Part) -> int:
        """The recorded scene that a request names; 0 when it is damaged, which playing reports."""
        try:
            request = self._recording.request(call, part)
        except Damaged:
            return 0
        return int((request.job if call.method == "RenderBatch" else request).scene)

    def tag_of(self, call: Call, part: Part) -> int | None:
        """Tag of an item of a RenderBatch; None: it is none."""
        try:
            request = self._recording.request(call, part)
        except Damaged:
            return 0
        return int(request.tag) if request.HasField("job") else None

    def scene_of_frame(self, frame: pb.RecordFrame) -> int:
        """The recorded scene that it shows; 0 when its manifest is damaged."""
        try:
            return int(_request_of(frame.manifest).scene)
        except (Damaged, NotPlayed):
            return 0

    # ------------------------------------------------------------ calls with one reply

    def whole(self, call: Call) -> None:
        """Makes all requests of the call."""
        assert call.status is not None
        status = call.status.item.status
        was: Any = status_error(status)
        if status.code == 0:
            if not call.replies:
                raise Damaged("its reply is not in the recording")
            was = merged(self._recording.reply(call, part) for part in call.replies)
        if call.method == "OpenScene" and status.code == 0 and was.scene not in self._scenes:
            raise NotPlayed(_BEFORE)
        self._compare(call, was, list(self._requests(call, was)))

    def branch(self, call: Call, revision: int) -> None:
        """Branches where the recorded call did."""
        was = self._recording.reply(call, call.replies[-1])
        request = self._recording.request(call, call.requests[0])
        request.revision = revision
        self._compare(call, was, [self.for_here(call, request, was)])

    def edit(self, call: Call, part: Part, was: Any) -> None:
        """Replays one edit, by Apply."""
        request = self._recording.request(call, part)
        request = self.for_here(call, request, was)
        _compare("Apply", was, self._ask(call, "Apply", [request]))

    def _requests(self, call: Call, was: Any) -> Iterator[Any]:
        if isinstance(was, service.UploadBlobReply) and was.existed:
            first = self._recording.request(call, call.requests[0])
            if first.sha256 not in self._blobs:
                raise NotPlayed("its bytes were there before the recording began")
            call = self._blobs[first.sha256]
        for part in call.requests:
            yield self.for_here(call, self._recording.request(call, part), was)

    def _compare(self, call: Call, was: Any, requests: list[Any]) -> None:
        found = self._ask(call, call.method, requests)
        is_scene = isinstance(was, service.SceneInfo) and isinstance(found, service.SceneInfo)
        if is_scene:
            here = self._scenes.setdefault(was.scene, found.scene)
            self._names[was.scene] = was.name
            if here != found.scene:
                raise Differs("another scene has this name")
        _compare(call.method, was, found)

    # ------------------------------------------------------------ frames

    def render(self, call: Call, was: Any) -> None:
        """Render at the revision that was shown. was: its frames, or its HeliographError."""
        request = self._recording.request(call, call.requests[0])
        self._show(call, request, request, was)

    def item(self, call: Call, part: Part, was: Any) -> None:
        """An item of a RenderBatch, as a batch of its own."""
        request = self._recording.request(call, part)
        request.credits = 1
        self._show(call, request, request.job, was)

    def again(self, call: Call, frame: pb.RecordFrame) -> None:
        """A frame from its manifest."""
        request = _request_of(frame.manifest)
        found = self._frames(call, self.for_here(call, request, None))
        if isinstance(found, HeliographError):
            raise found
        _compare_frame(frame, found.get(0))

    def _show(self, call: Call, request: Any, job: render_pb2.RenderRequest, was: Any) -> None:
        """`job`: the RenderRequest that is, or is in, the request."""
        is_accepted = not isinstance(was, HeliographError)
        if is_accepted and job.HasField("seconds"):  # how many samples there are depends on time
            for frame in was:
                self.again(call, frame)
            return
        self.for_here(call, job, was)
        if is_accepted:
            if not any(frame.final for frame in was):
                raise NotPlayed("it sent no final frame")
            job.revision = was[0].revision
            job.progressive = False
        found = self._frames(call, request)
        if not is_accepted or isinstance(found, HeliographError):
            return _compare("", was, found)
        for frame in was:
            if frame.final:
                _compare_frame(frame, found.get(frame.frame))
        return None

    def _frames(self, call: Call, request: Any) -> dict[int, Rendered] | HeliographError:
        """The final frames, by camera."""
        link = self.link(call)
        is_item = isinstance(request, service.RenderBatchRequest)
        assembly = Assembly(0, link.shared)
        found: dict[int, Rendered] = {}
        try:
            if is_item:
                replies = link.method("RenderBatch")(iter([request]), metadata=link.metadata)
            else:
                replies = link.method("Render")(request, metadata=link.metadata)
            for reply in replies:
                if is_item and reply.HasField("status"):
                    return status_error(reply.status)
                frame = assembly.add_part(reply.part if is_item else reply)
                if isinstance(frame, Rendered) and frame.is_final:
                    found[frame.index] = frame
        except grpc.RpcError as error:
            return to_error(error)
        return found


# ---------------------------------------------------------------- parts of messages


def merged(replies: Iterable[Any]) -> Any:
    """Merges the replies in which a DecodeAsset describes its asset."""
    whole: Any = None
    for reply in replies:
        if whole is None:
            whole = type(reply)()
        whole.MergeFrom(reply)
    return whole


def arrays_of(message: Any) -> Iterator[types.Array]:
    """Yields every Array in a message."""
    if isinstance(message, types.Array):
        yield message
        return
    for field, value in message.ListFields():
        if field.message_type is None or field.message_type.GetOptions().map_entry:
            continue
        for inner in [value] if isinstance(value, Message) else value:
            yield from arrays_of(inner)


def _pieces(
    first: service.UploadBlobRequest, data: bytes, size: int
) -> Iterator[service.UploadBlobRequest]:
    """The messages of an upload."""
    request = first
    for start in range(0, max(1, len(data)), size):
        request.chunk = data[start : start + size]
        yield request
        request = service.UploadBlobRequest()


def _request_of(manifest: str) -> render_pb2.RenderRequest:
    try:
        fields = json.loads(manifest)
        request = ParseDict(fields["request"], render_pb2.RenderRequest())
    except (ValueError, TypeError, KeyError, ParseError):
        raise Damaged("its manifest is damaged") from None
    if fields.get("overlay") and not request.HasField("overlay"):
        raise NotPlayed("its overlay was too large for the manifest")
    if fields.get("worlds") and not request.HasField("worlds"):
        raise NotPlayed("its worlds were too large for the manifest")
    return request


# ---------------------------------------------------------------- comparing


def outcome(answer: Any) -> str:
    if isinstance(answer, HeliographError):
        return f"{answer.code} ({answer})"
    return "accepted"


def _compare(method: str, was: Any, found: Any) -> None:
    """Raises Differs. Compares the code and the field of errors, and COMPARED of replies."""
    if isinstance(was, HeliographError) or isinstance(found, HeliographError):
        if key_of(was) != key_of(found):
            raise Differs(f"{outcome(found)}; it was {outcome(was)}")
        return
    for name in COMPARED[method]:
        old, new = getattr(was, name), getattr(found, name)
        if old != new:
            short = isinstance(old, (int, str, bool))
            raise Differs(f"{name} is {new!r}; it was {old!r}" if short else f"another {name}")


def key_of(answer: Any) -> tuple[str, str]:
    return (answer.code, answer.field) if isinstance(answer, HeliographError) else ("", "")


def _compare_frame(was: pb.RecordFrame, found: Rendered | None) -> None:
    name = f"frame {was.frame} of revision {was.revision}"
    if found is None:
        raise Differs(f"{name} did not come")
    if found.samples != was.samples:
        raise Differs(f"{name} has {found.samples} samples per pixel; it had {was.samples}")
    if found.sha256 != was.sha256:
        raise Differs(f"{name} has other pixels or labels")
