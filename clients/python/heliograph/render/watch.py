"""Watch: the transactions of a scene as they are published. Made by Scene.watch."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire.arrays import NdArray
from .._wire.connection import Stream
from .._wire.link import Patience
from ..errors import Cancelled, HeliographError, Unavailable
from ..values.checks import whole_of

if TYPE_CHECKING:
    from ..client.scene import Scene


@dataclasses.dataclass(frozen=True)
class AppliedEdit:
    """Edit of a Change.

    action: "entity", "mesh", "material", "texture", "volume", "remove", "instantiate", "instances",
    "poses", "settings", "advance" or "prune". name: of its target, "" where the edit has none or
    names it by its id. ids: (N,) uint64 of the objects that it put, made, moved or removed; those
    of large arrays of poses are not listed. fields: the components that it put, e.g. ("pose",
    "light"). message: the Edit itself.
    """

    action: str
    name: str
    ids: NdArray
    fields: tuple[str, ...]
    message: pb.Edit


class Change:
    """Transaction of a scene, by any client.

    revision: the one it made. transaction: as it was sent; uploaded arrays have dtype and shape
    only. A bookmark (`.is_bookmark`) has none: nothing else happened up to its revision.
    """

    def __init__(self, reply: service.WatchReply) -> None:
        self.revision = reply.revision
        self.is_bookmark = not reply.HasField("transaction")
        self.transaction = reply.transaction
        self._ids = np.frombuffer(reply.ids, dtype="<u8")
        self._counts = reply.counts

    @property
    def edits(self) -> list[AppliedEdit]:
        """Edits of the change, in order."""
        listed = self.transaction.edits
        out = []
        first = len(listed)  # of the further ids of the next edit
        for index, edit in enumerate(listed):
            last = first + self._counts[index]
            ids = np.concatenate([self._ids[index : index + 1], self._ids[first:last]])
            out.append(_applied(edit, ids[ids != 0]))
            first = last
        return out

    def __repr__(self) -> str:
        what = "bookmark" if self.is_bookmark else ", ".join(e.action for e in self.edits)
        return f"<Change {self.revision}: {what}>"


def _applied(edit: pb.Edit, ids: NdArray) -> AppliedEdit:
    action = edit.WhichOneof("action") or ""
    put = getattr(edit, action) if action else None
    fields = [field.name for field, _ in put.ListFields()] if put is not None else []
    if "clear" in fields:
        fields.remove("clear")
        fields.extend(put.clear)  # type: ignore[union-attr]
    if not ids.size and edit.target.id:
        ids = np.array([edit.target.id], dtype="<u8")
    if action == "poses":
        ids = np.frombuffer(edit.poses.ids.inline, dtype="<u8")
    return AppliedEdit(action, edit.target.name, ids, tuple(fields), edit)


def is_final(error: HeliographError) -> bool:
    """True if asking again is in vain: the private daemon died."""
    return isinstance(error, Unavailable) and error.exit_code is not None


class Watch:
    """Changes of a scene: `with scene.watch() as watch: for change in watch: ...`

    Iterating gives the next Change and blocks until there is one: each revision once, in order,
    none left out, also across lost connections and, for durable scenes, a daemon that was
    restarted. OutOfRange: the daemon no longer keeps the next one. `.revision`: all up to it was
    given. Thread: one iterates, any may close().
    """

    def __init__(
        self, scene: Scene, from_revision: int | None, bookmark_seconds: float | None
    ) -> None:
        first = 0 if from_revision is None else whole_of(from_revision, "from_revision", 1)
        self.revision = 0
        self._scene = scene
        self._bookmark_seconds = bookmark_seconds
        self._closed = False
        self._stream: Stream | None = None
        self._replies: Iterator[Any] = iter(())
        self._resume(first)

    def _open(self, first: int) -> None:
        """Begins at a revision, 0: the next one. The first reply has its number."""
        request = service.WatchRequest(
            scene=self._scene.id,
            from_revision=first,
            bookmark_seconds=self._bookmark_seconds or 0,
        )
        self._stream = self._scene.client.connection.stream("Watch", request)
        if self._closed:
            self._stream.cancel()
        self._replies = iter(self._stream)
        self.revision = next(self._replies).revision

    def _resume(self, first: int) -> None:
        """Opens the stream from a revision on, trying again while the daemon cannot be reached."""
        patience = Patience()
        while not self._closed:
            try:
                self._open(first)
                return
            except (Unavailable, Cancelled) as error:
                if is_final(error) or not patience.wait():
                    raise

    def __iter__(self) -> Watch:
        return self

    def __next__(self) -> Change:
        while not self._closed:
            try:
                reply = next(self._replies, None)
            except (Unavailable, Cancelled) as error:
                if is_final(error):
                    raise
                reply = None
            if reply is None:  # lost, or interrupted in an iteration before
                self._resume(self.revision + 1)
                continue
            self.revision = reply.revision
            change = Change(reply)
            if not change.is_bookmark or self._bookmark_seconds:
                return change
        raise StopIteration

    def close(self) -> None:
        """Ends it at once: the iteration stops. From any thread."""
        self._closed = True
        if self._stream is not None:
            self._stream.cancel()

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
