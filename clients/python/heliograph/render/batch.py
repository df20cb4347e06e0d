"""RenderBatch: many independent jobs on one call. Called by Scene.render_batch."""

from __future__ import annotations

import queue
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .._wire._proto import service_pb2 as service
from .._wire.connection import Stream
from .._wire.lent import Loan
from .._wire.status import status_error
from .._wire.uploads import missing
from ..errors import HeliographError, InvalidArgument
from ..scene.handles import Named, flatten
from ..values.checks import whole_of
from . import call
from ._assembly import Assembly
from .worlds import Worlds

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..client.scene import Scene


class Job:
    """Item of Scene.render_batch: cameras (one or several), any `tag`, and the options of
    Scene.render but progress, on_pass, on_start and timeout; or `worlds` and `mask` of
    Scene.render_worlds too."""

    def __init__(
        self,
        cameras: Any,
        *,
        tag: Any = None,
        worlds: Worlds | None = None,
        mask: Any = None,
        **options: Unpack[call.Options],
    ) -> None:
        self.cameras: Sequence[Named] = flatten(cameras, "cameras")
        self.tag = tag
        self.worlds, self.mask = worlds, mask
        self.options = options
        for name in ("progress", "on_pass", "on_start", "timeout"):
            if name in options:
                raise InvalidArgument(f"{name}: is of the whole batch, not of a Job", field=name)


@dataclass
class Result:
    """Result of a Job: its tag, and its frames in the order of its cameras (one WorldFrame for
    worlds), or its error."""

    tag: Any
    frames: list[Any] = field(default_factory=list)
    error: HeliographError | None = None

    @property
    def frame(self) -> Any:
        """The first camera's Frame, or the WorldFrame; raises the error when there is one."""
        if self.error is not None:
            raise self.error
        return self.frames[0]


@dataclass
class _Open:
    """A job under way."""

    job: Job
    assembly: Assembly
    loan: Loan | None


class _Batch:
    """Sends the next job when an item was answered, so that `credits` of them are under way."""

    def __init__(self, scene: Scene, jobs: Iterable[Job], credits: int) -> None:
        self.outbox: queue.SimpleQueue[service.RenderBatchRequest | None] = queue.SimpleQueue()
        self.refused: list[Result] = []
        self._scene = scene
        self._jobs = iter(jobs)
        self._open: dict[int, _Open] = {}
        self._sent = 0
        for _ in range(credits):
            self.send_next(credits if self._sent == 0 else 0)

    def send_next(self, credits: int) -> None:
        """Sends the next job that can be sent, or else the end."""
        for job in self._jobs:
            loan = None
            try:
                request = call.make_request(self._scene, job.cameras, job.options)
                if job.worlds is not None:
                    loan = job.worlds.put(request.worlds, self._scene.client.store, job.mask)
            except HeliographError as error:
                self.refused.append(Result(job.tag, error=error))
                continue
            self._sent += 1
            shared = self._scene.client.connection.link.shared
            assembly = Assembly(call.frame_count(request), shared)
            self._open[self._sent] = _Open(job, assembly, loan)
            self.outbox.put(
                service.RenderBatchRequest(tag=self._sent, job=request, credits=credits)
            )
            return
        self.outbox.put(None)

    def take(self, reply: service.RenderBatchReply) -> Result | None:
        """The result of the item that this reply ends."""
        here = self._open[reply.tag]
        if not reply.done:
            here.assembly.add_part(reply.part)
            return None
        del self._open[reply.tag]
        if not reply.HasField("status"):
            return Result(here.job.tag, here.assembly.frames())
        error = status_error(reply.status)
        try:
            return Result(here.job.tag, self._completed(here.job, error))
        except HeliographError as failure:
            return Result(here.job.tag, error=failure)

    def _completed(self, job: Job, error: HeliographError) -> list[Any]:
        """The frames of a job that was refused for uploads of its overlays, which are sent again;
        else raises the error. It is rendered by a call of its own: the batch may take no more."""
        if not missing(error):
            raise error
        options: call.Options = {**job.options, "progress": False}
        if job.worlds is None:
            return call.render(self._scene, job.cameras, options)
        return [call.render_worlds(self._scene, job.cameras, job.worlds, job.mask, options)]


class Results:
    """Iterates over Results as they are done. close(), from any thread, cancels the jobs under way;
    so does letting go of the iterator."""

    def __init__(
        self, scene: Scene, jobs: Iterable[Job], credits: int, timeout: float | None
    ) -> None:
        batch = _Batch(scene, jobs, whole_of(credits, "credits", 1))
        requests = iter(batch.outbox.get, None)
        self._outbox = batch.outbox
        self._stream = scene.client.connection.stream("RenderBatch", requests, timeout=timeout)
        self._results = _read(self._stream, batch)

    def close(self) -> None:
        self._stream.cancel()
        self._outbox.put(None)

    def __del__(self) -> None:
        if hasattr(self, "_stream"):
            self.close()

    def __iter__(self) -> Iterator[Result]:
        return self

    def __next__(self) -> Result:
        return next(self._results)


def _read(stream: Stream, batch: _Batch) -> Iterator[Result]:
    try:
        for reply in stream:
            result = batch.take(reply)
            if result is None:
                continue
            batch.send_next(1)
            yield result
            yield from batch.refused
            batch.refused.clear()
        yield from batch.refused
    finally:
        batch.outbox.put(None)
