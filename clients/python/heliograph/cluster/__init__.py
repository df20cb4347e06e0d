"""heliograph.cluster: one data set made by many processes, on Ray or as an array of jobs.

Images are pure in (seed, index), so that it makes no difference who makes them, or how often.
docs/training.md, "Many machines".
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..datasets._deal import dealt
from ..datasets.generating import Bar, Run, run_of
from ..errors import FailedPrecondition, InvalidArgument, Unavailable
from ..values.checks import number_of, whole_of
from ._maker import Maker, packed, shard_path

if TYPE_CHECKING:
    from ..client.scene import Scene
    from ..datasets.writer import Writer
    from ..render.progress import Progress

Shard = tuple[int, int]  # first image, one after the last
_STARTS = 3
_QUIET: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.WARNING}


@dataclass(frozen=True)
class Report:
    """Result of generate(). images: made by this call; skipped: present before; rejected: draws
    that `accept` refused; seconds; lost: how often a worker or its daemon was; core_seconds: CPU
    time for the images, without that of lost workers, None where a daemon is not a worker's own;
    gpu_seconds: time that GPUs were reserved."""

    images: int
    skipped: int
    rejected: int
    seconds: float
    lost: int
    core_seconds: float | None
    gpu_seconds: float

    def __str__(self) -> str:
        made = max(1, self.images)
        parts = [
            f"{self.images} images in {self.seconds:.1f} s",
            f"{self.images / max(self.seconds, 1e-9):.2f} images a second",
        ]
        if self.core_seconds is not None:
            parts.append(f"{self.core_seconds / made:.3g} core-seconds an image")
        if self.gpu_seconds:
            parts.append(f"{self.gpu_seconds / made:.3g} GPU-seconds an image")
        return ", ".join([*parts, f"{self.skipped} were there", f"{self.lost} losses"])


def share(count: int, part: int, parts: int, *, block: int = 1) -> list[int]:
    """The `indices` of hd.generate for part number `part` of `parts`: blocks of `block`
    consecutive images go round. With C cameras a multiple of C draws each draw once."""
    return list(dealt(count, part, parts, block=block))


def generate(
    scene: Scene,
    cameras: Any,
    randomizer: Callable[[Any], Any],
    *,
    count: int,
    writer: Writer | Sequence[Writer],
    workers: int,
    shard: int = 16,
    cores: float = 1,
    gpus: float = 0,
    connect: Mapping[str, Any] | None = None,
    credits: int = 2,
    tries: int = 5,
    progress: bool | Callable[[Progress], Any] | None = None,
    resume: bool = True,
    **options: Any,
) -> Report:
    """heliograph.datasets.generate by `workers` actors on Ray: the same files, byte for byte.

    The writer's directory is one that all machines see. Each worker loads the scene as it is now
    over a connection of its own: `connect` has the arguments of hg.connect(), default a private
    daemon. randomizer, accept and writer are pickled; handles in them serve there, too.
    shard: number of images that a worker gets at a time; a shard that is done is noted in
    DIR/.heliograph/shards, and skipped by a later call. cores, gpus: number that Ray reserves per
    worker. credits: draws under way in each. A worker or daemon that is lost costs its shard
    the images under way; the shard is given to another one, up to `tries` times. One that is lost
    `tries` times before it is ready ends the call, too: Unavailable with Ray's message.
    progress, resume, options: as of heliograph.datasets.generate.

    Where Ray was not initialized, it is for this call: on the cluster that RAY_ADDRESS names, else
    in processes of this machine that listen on its loopback address alone.
    """
    run = run_of(scene, cameras, randomizer, count=count, writer=writer, **options)
    asked = {"cameras": cameras, "randomizer": randomizer, "count": count, "writer": writer}
    need = {"num_cpus": number_of(cores, "cores"), "num_gpus": number_of(gpus, "gpus")}
    number = whole_of(workers, "workers", 1)
    width = whole_of(shard, "shard", 1) * len(run.source.cameras)
    start = time.monotonic()
    with _ray(number * need["num_cpus"], need["num_gpus"]) as ray:
        plan = packed(ray.cloudpickle.CloudPickler, scene, {**asked, **options})
        with run.opened(() if resume else range(count)):
            todo = [each for each in _shards(count, width) if not _is_done(run, each)]
            arguments = run.writers[0].folder.scene_path, plan, dict(connect or {}), credits
            team = _Team(ray, ray.remote(Maker).options(**need), arguments)
            with Bar(progress) as bar:
                shown = _Shown(bar, count, todo)
                made = team.make(todo, number, whole_of(tries, "tries", 1), shown)
            _finish(run)
    images = sum(each["images"] for each in made)
    used = [each["core_seconds"] for each in made]
    return Report(
        images=images,
        skipped=count - images,
        rejected=sum(each["rejected"] for each in made),
        seconds=time.monotonic() - start,
        lost=team.losses,
        core_seconds=None if None in used else sum(used),
        gpu_seconds=need["num_gpus"] * sum(each["seconds"] for each in made),
    )


def _finish(run: Run) -> None:
    """Writes the files that describe all images. FailedPrecondition where an image is missing."""
    run.begin()
    if not run.finish():
        raise FailedPrecondition(
            f"{run.writers[0].directory}: images of finished shards are missing; do "
            "machines that make them see the same directory?"
        )


def _shards(count: int, width: int) -> list[Shard]:
    return [(first, min(first + width, count)) for first in range(0, count, width)]


def _is_done(run: Run, shard: Shard) -> bool:
    folders = [writer.folder for writer in run.writers]
    return all((folder.root / shard_path(*shard)).exists() for folder in folders) and all(
        folder.has(index) for folder in folders for index in range(*shard)
    )


class _Shown:
    """The bar over all workers."""

    def __init__(self, bar: Bar, count: int, todo: Sequence[Shard]) -> None:
        self._bar, self._count = bar, count
        self._there = count - sum(end - first for first, end in todo)
        self._made = 0

    def add(self, images: int, skipped: int) -> None:
        self._made += images
        self._there += skipped
        self._bar.show(self._made, self._there, self._count)


class _Team:
    """Actors, and the shard of each of them; while one starts, the number of its attempt."""

    def __init__(self, ray: Any, kind: Any, arguments: Sequence[Any]) -> None:
        self._ray, self._kind, self._arguments = ray, kind, arguments
        self._busy: dict[Any, tuple[Any, Shard | int]] = {}
        self._todo: deque[Shard] = deque()
        self._tried: dict[Shard, int] = {}
        self.losses = 0

    def make(
        self, shards: Sequence[Shard], workers: int, tries: int, shown: _Shown
    ) -> list[dict[str, Any]]:
        """Has all shards made; returns the result of each."""
        self._todo.extend(shards)
        made: list[dict[str, Any]] = []
        idle: list[Any] = []
        shown.add(0, 0)
        try:
            for _ in range(min(workers, len(shards))):
                self._hire()
            while len(made) < len(shards):
                while self._todo and idle:
                    self._give(idle.pop(), self._todo.popleft())
                ready, _ = self._ray.wait(list(self._busy), num_returns=1)
                actor, task = self._busy.pop(ready[0])
                reply = self._reply(ready[0])
                self.losses += "lost" in reply
                if "ended" in reply:
                    self._replace(task, tries, reply["lost"])
                else:
                    idle.append(actor)
                if isinstance(task, int):
                    continue
                if "lost" in reply:
                    self._again(task, tries, reply["lost"])
                else:
                    made.append(reply)
                    shown.add(reply["images"], task[1] - task[0] - reply["images"])
        finally:
            for actor in [*idle, *(actor for actor, _ in self._busy.values())]:
                self._ray.kill(actor)
        return made

    def _hire(self, attempt: int = 1) -> None:
        actor = self._kind.remote(*self._arguments)
        self._busy[actor.ready.remote()] = actor, attempt

    def _replace(self, task: Shard | int, tries: int, why: str) -> None:
        """Another actor for one that ended."""
        if task == tries:
            raise Unavailable(
                f"workers: one ended {tries} times before it was ready; is heliograph installed on "
                f"every machine of the cluster? The last time: {why}"
            )
        self._hire(task + 1 if isinstance(task, int) else 1)

    def _give(self, actor: Any, shard: Shard) -> None:
        self._busy[actor.make.remote(*shard)] = actor, shard

    def _reply(self, reference: Any) -> dict[str, Any]:
        """Answer of an actor; "lost": why it was lost, "ended": the actor is gone. Raises its
        errors."""
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference) or {}
        except errors.RayTaskError as error:
            raise error.cause from error
        except errors.RayError as error:
            return {"lost": str(error), "ended": True}

    def _again(self, shard: Shard, tries: int, why: str) -> None:
        """Gives a shard back whose worker or daemon was lost."""
        self._tried[shard] = self._tried.get(shard, 0) + 1
        if self._tried[shard] >= tries:
            raise Unavailable(
                f"images {shard[0]} to {shard[1] - 1}: their worker was lost {tries} times; "
                f"the last time: {why}"
            )
        self._todo.appendleft(shard)


def _start(ray: Any, cores: int) -> None:
    """A Ray of this process's own. Its head waits for its parts, which now and then one of them
    keeps waiting for too long (seen with 2.60): then it is started again."""
    for left in reversed(range(_STARTS)):
        try:
            ray.init(num_cpus=max(1, cores), include_dashboard=False, **_QUIET)
            return
        except Exception as error:
            ray.shutdown()
            if left == 0:
                raise
            logging.getLogger("heliograph").warning("Ray did not start, once more: %s", error)


def _check_gpus(ray: Any, gpus: float) -> None:
    """A worker would wait for ever for GPUs that there are not."""
    there = ray.cluster_resources().get("GPU", 0)
    if gpus > there:
        raise InvalidArgument(
            f"gpus: a worker needs {gpus:g} and Ray finds {there:g} on this machine; ask for "
            "fewer, or name a cluster that has them by RAY_ADDRESS",
            field="gpus",
        )


@contextlib.contextmanager
def _ray(cores: float, gpus: float) -> Iterator[Any]:
    """Ray, initialized. cores: of all workers; gpus: of one."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    elsewhere = os.environ.get("RAY_ADDRESS")
    if not elsewhere:  # read when ray is imported: it listens on the loopback address alone
        os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
    import ray

    if ray.is_initialized():
        yield ray
        return
    if elsewhere:
        ray.init(address=elsewhere, **_QUIET)
    else:
        _start(ray, math.ceil(cores))
    try:
        if not elsewhere:
            _check_gpus(ray, gpus)
        yield ray
    finally:
        ray.shutdown()
