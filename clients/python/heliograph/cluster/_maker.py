"""Maker: makes shards of a data set in a process of its own. Used by generate()."""

from __future__ import annotations

import io
import json
import os
import pickle
import socket
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..client.scene import Scene
from ..datasets.folder import NAME
from ..datasets.generating import Bar, Run, run_of
from ..errors import InvalidArgument, Unauthenticated, Unavailable

if TYPE_CHECKING:
    from pathlib import Path

    from ..client.client import Client

_LOST = (Unavailable, Unauthenticated)


def packed(pickler: type[pickle.Pickler], scene: Scene, plan: Mapping[str, Any]) -> bytes:
    """The arguments of run_of, with handles of the scene as handles of whatever scene they are
    unpacked for. InvalidArgument where something is of another scene."""

    class Pickler(pickler):  # type: ignore[misc,valid-type]
        def persistent_id(self, thing: Any) -> str | None:
            if not isinstance(thing, Scene):
                return None
            if (thing.id, thing.client.address) != (scene.id, scene.client.address):
                raise InvalidArgument(f"{thing!r}: is not the scene of the data set", field="scene")
            return "scene"

    out = io.BytesIO()
    Pickler(out).dump(dict(plan))
    return out.getvalue()


def _unpacked(data: bytes, scene: Scene) -> dict[str, Any]:
    class Unpickler(pickle.Unpickler):
        def persistent_load(self, _: Any) -> Scene:
            return scene

    plan: dict[str, Any] = Unpickler(io.BytesIO(data)).load()
    return plan


def shard_path(first: int, end: int) -> str:
    """Path, below the data set's directory, of the file that marks images first .. end - 1 as
    done."""
    return f"{NAME}/shards/{first:09d}-{end:09d}.json"


class Maker:
    """Makes shards over a connection of its own, which it opens anew when its daemon is lost.

    scene_path: a file of Scene.save; plan: of packed(); connect: arguments of hg.connect().
    """

    def __init__(
        self, scene_path: Path, plan: bytes, connect: Mapping[str, Any], credits: int
    ) -> None:
        self._scene_path, self._plan, self._connect = scene_path, plan, connect
        self._credits = credits
        self._client: Client | None = None
        self._run: Run | None = None

    def ready(self) -> None:
        """Connects and loads the scene; a lost daemon is for make() to report."""
        try:
            self._opened()
        except _LOST:
            self.close()

    def make(self, first: int, end: int) -> dict[str, Any]:
        """Makes the images first .. end - 1. Returns the content of the shard's file, or {"lost":
        why}."""
        start, used = time.monotonic(), self._cpu_seconds()
        try:
            run = self._opened()
            done = run.make(range(first, end), self._credits, Bar(False))
            shard = {
                "first": first,
                "end": end,
                "images": done.images,
                "rejected": done.rejected,
                "seconds": round(time.monotonic() - start, 3),
                "core_seconds": self._core_seconds(used),
                "host": socket.gethostname(),
                "process": os.getpid(),
            }
            run.source.rejected = 0
            for writer in run.writers:
                writer.folder.put(shard_path(first, end), json.dumps(shard))
            return shard
        except _LOST as error:
            self.close()
            return {"lost": str(error)}

    def _opened(self) -> Run:
        if self._run is None:
            from .. import connect

            self._client = connect(**self._connect)
            scene = self._client.load_scene(self._scene_path)
            self._run = run_of(scene, **_unpacked(self._plan, scene))
            self._run.begin()
        return self._run

    def _cpu_seconds(self) -> float:
        """CPU seconds of this process and its private daemon so far."""
        daemon = self._client.connection.daemon if self._client is not None else None
        is_there = daemon is not None and daemon.exit_code() is None
        return time.process_time() + (daemon.cpu_seconds() if daemon and is_there else 0.0)

    def _core_seconds(self, since: float) -> float | None:
        """None where the daemon is not this process's own."""
        if self._client is None or self._client.connection.daemon is None:
            return None
        return round(self._cpu_seconds() - since, 3)

    def close(self) -> None:
        """Ends the connection; the next shard opens one."""
        client, self._client, self._run = self._client, None, None
        if client is not None:
            client.close()
