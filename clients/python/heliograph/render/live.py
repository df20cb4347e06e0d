"""Stream: a live picture of a scene. Made by Scene.stream."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .._wire._proto import service_pb2 as service
from .._wire.connection import Stream
from .._wire.shared import SharedFrames
from ..errors import HeliographError, InvalidArgument
from ..scene.handles import flatten
from ..values.checks import whole_of
from . import call
from ._assembly import Assembly
from .frame import Frame

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..client.scene import Scene

POLICIES = ("latest", "lossless")


class Live:
    """Frames of a scene as it changes: `with scene.stream(cam) as live: for frame in live: ...`

    Iterating gives the next Frame, and blocks until there is one; `.revision` is the one it shows,
    `.is_final` is True if its refinement is over: the next one then comes with an update() or an
    edit. Asking for the next frame returns the credit of the last one. Thread: one iterates, any
    may call update(), finish() and close().
    """

    def __init__(
        self, scene: Scene, cameras: Any, policy: str, credits: int, options: call.Options
    ) -> None:
        if policy not in POLICIES:
            raise InvalidArgument(
                f"policy: one of {', '.join(POLICIES)}, not {policy!r}", field="policy"
            )
        for name in ("progress", "on_pass", "on_start"):
            if name in options:
                raise InvalidArgument(f"{name}: is not for a stream, leave it out", field=name)
        self._scene = scene
        self._cameras = cameras
        self._options = options
        self._progressive = policy == "latest"
        self._policy, self._credits = policy, whole_of(credits, "credits", 1)
        self._lock = threading.Lock()  # guards the request that a new stream begins with
        self._is_refused = self._is_finished = self._is_closed = False
        self._begin()

    def _begin(self) -> None:
        connection = self._scene.client.connection
        outbox: queue.SimpleQueue[service.StreamRequest | None] = queue.SimpleQueue()
        outbox.put(
            service.StreamRequest(
                settings=self._settings(),
                credits=self._credits,
                policy=f"POLICY_{self._policy.upper()}",
            )
        )
        if self._is_finished:
            outbox.put(None)
        self._outbox = outbox
        self._stream = connection.stream(
            "Stream", iter(outbox.get, None), raw=True, timeout=self._options.get("timeout")
        )
        self._frames = _read(self._stream, outbox, connection.link.shared)

    def _settings(self) -> Any:
        listed = flatten(self._cameras, "cameras")
        request = call.make_request(self._scene, listed, self._options)
        request.progressive = self._progressive
        return request

    def update(self, cameras: Any = None, **options: Unpack[call.Options]) -> None:
        """Changes the request from now on: other cameras, another overlay (None: none), any option
        of Scene.render. Omitted ones stay."""
        with self._lock:
            if cameras is not None:
                self._cameras = cameras
            self._options = {**self._options, **options}
            self._outbox.put(service.StreamRequest(settings=self._settings()))

    def finish(self) -> None:
        """Ends the iteration with the frame of the last update; takes no more updates."""
        with self._lock:
            self._is_finished = True
            self._outbox.put(None)

    def close(self) -> None:
        """Ends the stream at once."""
        with self._lock:
            self._is_closed = True
            self._stream.cancel()
            self._outbox.put(None)

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        overlay = self._options.get("overlay")
        if overlay is None:
            return next(self._frames)
        try:
            return overlay.sources.complete(self._scene.client, self._next)
        finally:
            self._is_refused = False

    def _next(self) -> Frame:
        """Next frame, of a new stream where the last one was refused for an upload, which was sent
        again."""
        with self._lock:
            if self._is_refused and not self._is_closed:
                self._begin()
        try:
            return next(self._frames)
        except HeliographError:
            self._is_refused = True
            raise

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def _read(
    stream: Stream,
    outbox: queue.SimpleQueue[service.StreamRequest | None],
    shared: SharedFrames | None,
) -> Iterator[Frame]:
    assembly = Assembly(0, shared)
    try:
        for data in stream:
            frame = assembly.add(data)
            if isinstance(frame, Frame):
                yield frame
                outbox.put(service.StreamRequest(credits=1))
    finally:
        outbox.put(None)
