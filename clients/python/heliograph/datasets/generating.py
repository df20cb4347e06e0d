"""generate(): draws, renders and writes images, several at a time.

A worker takes a draw from its overlay to its files; as many workers as jobs under way keep the
daemon busy while pictures are encoded.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import groupby, islice
from typing import TYPE_CHECKING, Any

import numpy as np

from .._version import __version__
from ..errors import FailedPrecondition, InvalidArgument, Unavailable
from ..render.progress import Progress, is_watched
from ..values.checks import whole_of
from .draw import Draw
from .record import Record, claimed
from .source import Drawn, Source, naming
from .splits import Splits
from .uploads import named
from .writer import Dataset, Image, Records, Writer

if TYPE_CHECKING:
    from ..client.scene import Scene

_OWN = ("planes", "overlay", "revision", "progress", "on_pass", "on_start", "timeout", "half")


@dataclass(frozen=True)
class Summary:
    """Result of generate(). images: made by this call; skipped: present before; rejected: draws
    that `accept` refused; seconds; complete: True if all images of the data set are there."""

    images: int
    skipped: int
    rejected: int
    seconds: float
    complete: bool


def generate(
    scene: Scene,
    cameras: Any,
    randomizer: Callable[[Draw], Any],
    *,
    count: int,
    writer: Writer | Sequence[Writer],
    spp: int = 64,
    seed: int = 0,
    indices: Iterable[int] | None = None,
    accept: Callable[[Any], Any] | None = None,
    attempts: int = 100,
    labels: Any = None,
    splits: Mapping[str, float] | None = None,
    credits: int = 4,
    progress: bool | Callable[[Progress], Any] | None = None,
    resume: bool = True,
    **options: Any,
) -> Summary:
    """Makes a data set of `count` images.

    cameras: one or several; image i is of draw i // C seen by camera i % C. randomizer: called with
    a Draw for each draw, and again for each attempt; it writes into draw.edit, an overlay, and
    draws from draw.rng alone, so that every image is a pure function of (seed, i). writer: one or
    several, each with a directory of its own.
    indices: make these only, a shard; the one that makes the last missing image finishes the data
    set. resume: True makes only missing images; False makes all, or all of `indices`, again.
    accept: called once per camera with the label columns of a draw, before anything is shaded; if
    it returns False, the draw is rejected and drawn anew, up to `attempts` times. labels: the
    columns of accept and of the frames; by default all but masks, for accept alone.
    splits: {"train": 0.8, "val": 0.2}: shares of the draws. credits: number of draws under way.
    progress: None shows a bar where one is watched; a callable gets hg.Progress of images.
    options: of Scene.render: size, max_depth, ...

    Do not edit the scene meanwhile. Raises the daemon's errors, with the image's number in front,
    and a RuntimeError for any other error of a randomizer or a writer, as its cause; images that
    are done stay.
    """
    run = run_of(
        scene,
        cameras,
        randomizer,
        count=count,
        writer=writer,
        spp=spp,
        seed=seed,
        accept=accept,
        attempts=attempts,
        labels=labels,
        splits=splits,
        **options,
    )
    wanted = run.checked(indices)
    with run.opened(() if resume else wanted):
        run.begin()
        summary = run.make(wanted, whole_of(credits, "credits", 1), Bar(progress))
        return replace(summary, complete=run.finish())


def run_of(
    scene: Scene,
    cameras: Any,
    randomizer: Callable[[Draw], Any],
    *,
    count: int,
    writer: Writer | Sequence[Writer],
    spp: int = 64,
    seed: int = 0,
    accept: Callable[[Any], Any] | None = None,
    attempts: int = 100,
    labels: Any = None,
    splits: Mapping[str, float] | None = None,
    **options: Any,
) -> Run:
    """Run of generate() with these arguments, not begun yet."""
    refused = sorted(set(options) & set(_OWN))
    if refused:
        raise InvalidArgument(
            f"{refused[0]}: generate() sets it; writers say which planes they need",
            field=refused[0],
        )
    writers = [writer] if isinstance(writer, Writer) else list(writer)
    source = Source(
        scene,
        cameras,
        randomizer,
        seed=seed,
        accept=accept,
        attempts=attempts,
        labels=labels,
        options={**options, "spp": whole_of(spp, "spp", 1)},
        is_kept=lambda digest: all(each.folder.has_blob(digest) for each in writers),
    )
    shares = Splits(splits)
    dataset = Dataset(
        scene,
        source.cameras,
        whole_of(count, "count", 1),
        source.seed,
        shares.names,
        scene.categories,
    )
    description = {
        "count": dataset.count,
        "seed": source.seed,
        "cameras": [camera.name or camera.id for camera in dataset.cameras],
        "categories": {str(k): v for k, v in dataset.categories.items()},
        "splits": shares.shares,
        "accept": accept is not None,
        "options": {**options, "spp": spp},
    }
    wanted = merged([each.labels for each in writers] + [labels or False])
    return Run(dataset, source, writers, wanted, shares, description)


@dataclass
class Run:
    """The steps of generate(): `with opened()` once for a data set; begin(), then make() as often
    as one likes, in each process that makes images of it; finish() when all are there."""

    dataset: Dataset
    source: Source
    writers: list[Writer]
    labels: dict[str, Any]
    splits: Splits
    description: dict[str, Any]
    records: list[Record] = field(default_factory=list)  # while it is opened

    @property
    def planes(self) -> list[str]:
        return list(dict.fromkeys(plane for writer in self.writers for plane in writer.planes))

    # ------------------------------------------------------------ the data set

    @contextmanager
    def opened(self, again: Sequence[int]) -> Iterator[None]:
        """Begins the data set, or goes on with it; again: images that are to be made once more.
        FailedPrecondition where one of the directories is another one's."""
        roots = [writer.directory.resolve() for writer in self.writers]
        if not roots or len(set(roots)) < len(roots):
            raise InvalidArgument(
                "writer: needs at least one, each with a directory of its own", field="writer"
            )
        made_by = {"version": __version__, "numpy": np.__version__}
        self.records = [
            Record(each.folder, {**made_by, **self.description, "writer": each.settings})
            for each in self.writers
        ]
        with claimed(
            self.records,
            self.dataset.scene,
            again if isinstance(again, range) else frozenset(again),
        ):
            try:
                yield
            finally:
                for writer in self.writers:
                    writer.end()

    def begin(self) -> None:
        for writer in self.writers:
            writer.begin(self.dataset)

    def make(self, wanted: Sequence[int], credits: int, bar: Bar) -> Summary:
        """Makes the wanted images that are not there yet. Summary.complete is left False."""
        start = time.monotonic()
        skipped = _Count()
        draws = self._draws(wanted, skipped)
        made = 0
        with bar, ThreadPoolExecutor(credits, "heliograph-generate") as pool:
            running: set[Future[int]] = set()
            try:
                while True:
                    for draw, images in islice(draws, credits - len(running)):
                        running.add(pool.submit(self._make, draw, images))
                    bar.show(made, skipped.value, len(wanted))
                    if not running:
                        break
                    done, running = wait(running, return_when=FIRST_COMPLETED)
                    made += sum(future.result() for future in done)
            except BaseException:
                self.source.stop()
                raise
        seconds = time.monotonic() - start
        return Summary(made, skipped.value, self.source.rejected, seconds, False)

    def checked(self, indices: Iterable[int] | None) -> Sequence[int]:
        """Indices for make(), within [0, count); None: all. InvalidArgument."""
        count = self.dataset.count
        if indices is None:
            return range(count)
        listed = indices if isinstance(indices, range) else [int(i) for i in indices]
        if listed and (min(listed) < 0 or max(listed) >= count):
            raise InvalidArgument(f"indices: are within [0, {count})", field="indices")
        return listed

    def _draws(self, wanted: Sequence[int], skipped: _Count) -> Iterator[tuple[int, list[int]]]:
        """(draw, its images that are not there)."""
        cameras = len(self.dataset.cameras)
        for draw, images in groupby(wanted, lambda i: i // cameras):
            missing = []
            for index in images:
                if all(writer.folder.has(index) for writer in self.writers):
                    skipped.value += 1
                else:
                    missing.append(index)
            if missing:
                yield draw, missing

    def finish(self) -> bool:
        """True if all images are there; if so, writes the files that describe all of them."""
        for writer, record in zip(self.writers, self.records):
            with writer.folder.alone():
                record.check()
                count = record.count()
                if not all(writer.folder.has(index) for index in range(count)):
                    return False
                writer.finish(Records(writer.folder, count))
        return True

    # ------------------------------------------------------------ one draw

    def _make(self, draw: int, images: list[int]) -> int:
        """Draws, renders and writes some images of a draw; how many. In a worker."""
        with naming(images[0]):
            try:
                drawn = self.source.draw(draw)
                self._render(draw, images, drawn)
            except Unavailable as error:
                stays = "images that are done stay: call generate() again"
                error.args = (f"{error}; {stays}", *error.args[1:])
                raise
        return len(images)

    def _render(self, draw: int, images: list[int], drawn: Drawn) -> None:
        if drawn.edit.is_lent:
            raise InvalidArgument(
                "randomizer: an array on a GPU cannot be kept with the image: give it as numpy",
                field="randomizer",
            )
        cameras = [self.dataset.camera_of(index) for index in images]
        frames = self.source.frames(
            draw, drawn.edit, cameras, planes=self.planes, labels=self.labels
        )
        split = self.splits.of(self.dataset.seed, draw)
        for index, frame in zip(images, frames):
            frame.manifest = _portable(frame.manifest)
            self._write(Image(index, frame, split, drawn.edit), drawn)

    def _write(self, image: Image, drawn: Drawn) -> None:
        unknown = dict(image.frame.categories.items() - self.dataset.categories.items())
        if unknown:
            raise FailedPrecondition(
                f"category: {', '.join(unknown.values())} is registered by the randomizer alone, "
                "so that its id would depend on the draw; register it before generate() with "
                "edit.categories(...)",
                field="category",
            )
        transaction = drawn.edit.transaction
        overlay = transaction.SerializeToString(deterministic=True)
        names = list(named(transaction))
        for writer in self.writers:
            if writer.folder.has(image.index):
                continue
            record = {
                "record": writer.write(image),
                "split": image.split,
                "attempt": drawn.attempt,
                "sha256": image.frame.sha256.hex(),
            }
            drawn.uploads.keep(writer.folder, names, self.dataset.scene.client.store)
            writer.folder.keep(image.index, record, image.frame.manifest, overlay)


def _portable(manifest: str) -> str:
    """A manifest without the numbers that this daemon gave the scene and its revision, and without
    the trace that asked for it: the same image has the same bytes wherever it is made."""
    fields = json.loads(manifest)
    fields.pop("trace", None)
    for name in ("scene", "revision"):
        fields["request"].pop(name, None)
    return json.dumps(fields, separators=(",", ":"), sort_keys=True)


class _Count:
    value = 0


def merged(requests: Iterable[Any]) -> dict[str, Any]:
    """Merges label requests (each True, False, a mapping or names) into one. InvalidArgument where
    two ask for different values."""
    out: dict[str, Any] = {}
    for request in requests:
        if request is True:
            request = ("boxes", "amodal", "keypoints")
        if not isinstance(request, Mapping):
            request = dict.fromkeys(request or (), True)
        for name, value in request.items():
            if out.setdefault(name, value) != value:
                raise InvalidArgument(
                    f"labels: one asks for {name} of {out[name]}, another of {value}; write them "
                    "in two calls",
                    field=f"labels.{name}",
                )
    return out


class Bar:
    """Progress over the images."""

    def __init__(self, mode: bool | Callable[[Progress], Any] | None) -> None:
        self._callback = mode if callable(mode) else None
        self._wanted = mode is True or (mode is None and is_watched())
        self._start = time.monotonic()
        self._bar: Any = None

    def __enter__(self) -> Bar:
        return self

    def show(self, made: int, skipped: int, total: int) -> None:
        if self._callback is not None:
            passed = time.monotonic() - self._start
            left = (total - made - skipped) * passed / made if made else float("nan")
            self._callback(Progress(made + skipped, total, float("nan"), left, float("nan")))
        elif self._wanted:
            if self._bar is None:
                from tqdm.auto import tqdm

                self._bar = tqdm(total=total, desc="generate", unit="image", initial=skipped)
            self._bar.update(made + skipped - self._bar.n)

    def __exit__(self, *_: Any) -> None:
        if self._bar is not None:
            self._bar.close()
