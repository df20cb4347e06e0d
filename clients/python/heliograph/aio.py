"""Async twins of the client: every method of Client and Scene that talks to the daemon is awaited.

    async with await heliograph.aio.connect() as client:
        scene = await client.create_scene()
        async with scene.edit() as edit:
            ...                                   # building an edit does not wait
        frame = await scene.render("cam", spp=64)

Each call runs in a thread of its own pool. Edits of a client go out in the order in which they were
started; cancelling a render cancels the job.
"""

from __future__ import annotations

import asyncio
import contextvars
import functools
import os
import weakref
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from . import connect as _connect
from .client.client import Client as _Client
from .client.edit import Edits
from .client.scene import Overlay
from .client.scene import Scene as _Scene
from .render.frame import Frame
from .render.live import Live as _Live
from .render.watch import Change
from .render.watch import Watch as _Watch
from .render.worlds import WorldFrame, Worlds
from .scene.handles import Handle

_THREADS = 16


class _Pool:
    """Threads for calls, and one thread for edits, which keeps their order."""

    def __init__(self) -> None:
        self.forget_parent()
        _pools.add(self)

    def forget_parent(self) -> None:
        """Replaces the thread pools, in a forked child, which has none of the threads."""
        self._calls = ThreadPoolExecutor(_THREADS, "heliograph-call")
        self._edits = ThreadPoolExecutor(1, "heliograph-edit")

    async def call(self, work: Callable[..., Any], *args: Any, **options: Any) -> Any:
        loop = asyncio.get_running_loop()
        context = contextvars.copy_context()  # which a trace may be in
        call = functools.partial(context.run, work, *args, **options)
        return await loop.run_in_executor(self._calls, call)

    async def edit(self, work: Callable[[], Any]) -> Any:
        """Runs an edit and awaits it to the end: a cancelled task does not interrupt it half
        way."""
        loop = asyncio.get_running_loop()
        context = contextvars.copy_context()
        return await asyncio.shield(loop.run_in_executor(self._edits, context.run, work))

    def close(self) -> None:
        self._calls.shutdown(wait=False)
        self._edits.shutdown(wait=False)


_pools: weakref.WeakSet[_Pool] = weakref.WeakSet()


def _in_child() -> None:
    for pool in list(_pools):
        pool.forget_parent()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


async def connect(address: str | None = None, **options: Any) -> Client:
    """See heliograph.connect."""
    pool = _Pool()
    try:
        return Client(await pool.call(_connect, address, **options), pool)
    except BaseException:
        pool.close()
        raise


class _Twin:
    """Awaits the named methods of `sync`; gives its other attributes as they are."""

    _awaited: frozenset[str] = frozenset()
    _scenes: frozenset[str] = frozenset()

    def __init__(self, sync: Any, pool: _Pool) -> None:
        self.sync = sync
        self._pool = pool

    def __getattr__(self, name: str) -> Any:
        if name in self._awaited or name in self._scenes:
            return functools.partial(self._await, name)
        raise AttributeError(f"{type(self).__name__} has no {name!r}; .sync is the blocking twin")

    async def _await(self, name: str, *args: Any, **options: Any) -> Any:
        args = tuple(arg.sync if isinstance(arg, _Twin) else arg for arg in args)
        found = await self._pool.call(getattr(self.sync, name), *args, **options)
        if name in self._scenes:
            if isinstance(found, list):
                return [Scene(scene, self._pool) for scene in found]
            return Scene(found, self._pool)
        return found

    def __repr__(self) -> str:
        return f"<async {self.sync!r}>"


class Client(_Twin):
    """create_scene, open_scene, load_scene, scenes, sessions, info, close: all awaited."""

    sync: _Client
    _scenes = frozenset({"create_scene", "open_scene", "load_scene", "scenes"})
    _awaited = frozenset({"info", "sessions"})

    @property
    def address(self) -> str:
        return self.sync.address

    async def close(self) -> None:
        await self._pool.call(self.sync.close)
        self._pool.close()

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, *_: Any) -> None:
        await self.close()


class Scene(_Twin):
    """The methods of heliograph.Scene, awaited; revision() and time() are methods here."""

    sync: _Scene
    _scenes = frozenset({"branch"})
    _awaited = frozenset(
        {
            *("describe", "resolve", "handle", "find", "tree", "memory", "transforms", "read"),
            *("cast_rays", "pick", "visible", "overlaps", "sample_surface", "tracks"),
            *("save", "export", "delete", "rerender"),
        }
    )

    @property
    def id(self) -> int:
        return self.sync.id

    @property
    def name(self) -> str:
        return self.sync.name

    async def revision(self) -> int:
        """The latest revision."""
        return int(await self._pool.call(lambda: self.sync.revision))

    async def time(self) -> float:
        """The scene's time, seconds."""
        return float(await self._pool.call(lambda: self.sync.time))

    def edit(self, *, expected_revision: int | None = None) -> _Edit:
        """`async with scene.edit() as edit:` one atomic transaction."""
        return _Edit(self.sync.edit(expected_revision=expected_revision), self._pool)

    def overlay(self) -> Overlay:
        """A plain `with`: an overlay sends nothing at its end."""
        return self.sync.overlay()

    async def render(self, cameras: str | Handle | Any, **options: Any) -> Any:
        """See heliograph.Scene.render. Cancelling the task cancels the job."""
        return await self._cancellable(self.sync.render, cameras, **options)

    async def render_worlds(self, cameras: Any, worlds: Worlds, **options: Any) -> WorldFrame:
        """See heliograph.Scene.render_worlds. Cancelling the task cancels the job."""
        frame: WorldFrame = await self._cancellable(
            self.sync.render_worlds, cameras, worlds, **options
        )
        return frame

    async def _cancellable(self, render: Callable[..., Any], *args: Any, **options: Any) -> Any:
        cancels: list[Callable[[], None]] = []
        options["on_start"] = cancels.append
        try:
            return await self._pool.call(render, *args, **options)
        except asyncio.CancelledError:
            for cancel in cancels:
                cancel()
            raise

    async def render_sequence(self, camera: Any, times: Any, **options: Any) -> AsyncIterator[Any]:
        """Yields one frame per time (seconds), all of one revision."""
        revision = options.pop("revision", None) or await self.revision()
        for t in np.asarray(times, dtype="f8").ravel():
            yield await self.render(camera, time=float(t), revision=revision, **options)

    async def render_batch(self, jobs: Any, **options: Any) -> AsyncIterator[Any]:
        """See heliograph.Scene.render_batch."""
        results = self.sync.render_batch(jobs, **options)
        try:
            while (result := await self._pool.call(next, results, None)) is not None:
                yield result
        finally:
            results.close()

    def stream(self, cameras: Any, **options: Any) -> Live:
        """`async with scene.stream(cam) as live: async for frame in live:`, as in
        heliograph.Scene.stream."""
        return Live(self.sync.stream(cameras, **options), self._pool)

    def watch(self, from_revision: int | None = None, **options: Any) -> Watch:
        """`async with scene.watch() as watch: async for change in watch:`, as in
        heliograph.Scene.watch."""
        return Watch(functools.partial(self.sync.watch, from_revision, **options))

    async def __aenter__(self) -> Scene:
        return self

    async def __aexit__(self, *_: Any) -> None:
        await self._pool.call(self.sync.__exit__, None, None, None)


class Live:
    """The twin of the stream of heliograph.Scene.stream; update() and finish() do not wait."""

    def __init__(self, sync: _Live, pool: _Pool) -> None:
        self.sync = sync
        self._pool = pool
        self.update, self.finish, self.close = sync.update, sync.finish, sync.close

    def __aiter__(self) -> Live:
        return self

    async def __anext__(self) -> Frame:
        frame = await self._pool.call(next, self.sync, None)
        if frame is None:
            raise StopAsyncIteration
        return frame  # type: ignore[no-any-return]

    async def __aenter__(self) -> Live:
        return self

    async def __aexit__(self, *_: Any) -> None:
        self.close()


class Watch:
    """The twin of heliograph.Scene.watch's. It waits in a thread of its own."""

    sync: _Watch

    def __init__(self, begin: Callable[[], _Watch]) -> None:
        self._begin = begin
        self._thread = ThreadPoolExecutor(1, "heliograph-watch")

    @property
    def revision(self) -> int:
        """Last revision whose change was given."""
        return self.sync.revision

    async def __aenter__(self) -> Watch:
        self.sync = await asyncio.get_running_loop().run_in_executor(self._thread, self._begin)
        return self

    def __aiter__(self) -> Watch:
        return self

    async def __anext__(self) -> Change:
        loop = asyncio.get_running_loop()
        change = await loop.run_in_executor(self._thread, next, self.sync, None)
        if change is None:
            raise StopAsyncIteration
        return change

    def close(self) -> None:
        """Ends it: the iteration stops."""
        self.sync.close()

    async def __aexit__(self, *_: Any) -> None:
        self.close()
        self._thread.shutdown(wait=False)


class _Edit:
    def __init__(self, edits: Edits, pool: _Pool) -> None:
        self._edits = edits
        self._pool = pool

    async def __aenter__(self) -> Edits:
        return self._edits

    async def __aexit__(self, kind: Any, value: Any, trace: Any) -> None:
        await self._pool.edit(functools.partial(self._edits.__exit__, kind, value, trace))
