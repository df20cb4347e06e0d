"""Source: the draws of a scene, and their frames. Used by generate() and heliograph.torch."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import HeliographError
from ..scene.handles import Handle, Named, flatten
from ..values.checks import whole_of
from .draw import BasePoses, Draw, render_seed
from .tries import gave_up
from .uploads import Uploads

if TYPE_CHECKING:
    from ..client.edit import Edits
    from ..client.scene import Scene
    from ..render.frame import Frame


class Drawn(NamedTuple):
    """An accepted draw. attempt: how many were rejected before it."""

    attempt: int
    edit: Edits
    uploads: Uploads


@contextmanager
def naming(index: int) -> Iterator[None]:
    """Puts the image's number in front of errors; a foreign one becomes the cause of a
    RuntimeError."""
    try:
        yield
    except HeliographError as error:
        error.args = (f"image {index}: {error}", *error.args[1:])
        raise
    except Exception as error:
        raise RuntimeError(f"image {index}: {type(error).__name__}: {error}") from error


class Source:
    """Source of draws: number i of a seed, in the scene as it is now. Thread: any; the randomizer
    and `accept` are called one at a time. Arguments are as of generate(); is_kept(SHA-256) is True
    for bytes that the data set holds, which no upload needs to carry."""

    def __init__(
        self,
        scene: Scene,
        cameras: Named | Sequence[Named],
        randomizer: Callable[[Draw], Any],
        *,
        seed: int,
        accept: Callable[[Any], Any] | None = None,
        attempts: int = 100,
        labels: Any = None,
        options: Mapping[str, Any],
        is_kept: Callable[[bytes], bool] = lambda digest: True,
    ) -> None:
        self.scene, self.revision = scene, scene.revision
        listed = flatten(cameras, "cameras")
        self.cameras: list[Handle] = [
            scene.handle(camera) if isinstance(camera, str) else camera for camera in listed
        ]
        self.seed = whole_of(seed, "seed", 0, 2**64 - 1)
        self.rejected = 0
        self._randomizer, self._accept = randomizer, accept
        self._attempts = whole_of(attempts, "attempts", 1)
        self._seen = True if labels is None else labels
        self._options = dict(options)
        self._base = BasePoses(scene)
        self._is_kept = is_kept
        self._drawing = threading.Lock()
        self._cancels: set[Callable[[], None]] = set()
        self._stopped = False

    def draw(self, index: int) -> Drawn:
        """The first attempt of a draw that is accepted."""
        store = self.scene.client.store
        for attempt in range(self._attempts):
            edit, uploads = self.scene.overlay(), Uploads(self._is_kept)
            key = (self.seed, index, attempt)
            with self._drawing, edit, store.witnessed(uploads.note):
                self._randomizer(Draw(self._base, self.cameras, key, edit))
            if self._accept is None or self._is_accepted(edit):
                return Drawn(attempt, edit, uploads)
            with self._drawing:
                self.rejected += 1
        raise gave_up(
            f"accept: none of {self._attempts} attempts was accepted; ask for less, or raise "
            "attempts=",
            "attempts",
            self._attempts,
        )

    def _is_accepted(self, edit: Edits) -> bool:
        assert self._accept is not None
        options = {k: v for k, v in self._options.items() if k != "spp"}
        frames = self._render(self.cameras, overlay=edit, planes=[], labels=self._seen, **options)
        with self._drawing:
            return all(bool(self._accept(frame.labels)) for frame in frames)

    def frames(
        self, index: int, edit: Edits, cameras: Sequence[Handle], **options: Any
    ) -> list[Frame]:
        """Renders a draw and its overlay: one frame per camera. options: planes and labels."""
        seed = render_seed(self.seed, index)
        return self._render(cameras, overlay=edit, seed=seed, **options, **self._options)

    def stop(self) -> None:
        """Cancels the jobs under way, and any later one."""
        self._stopped = True
        for cancel in list(self._cancels):
            cancel()

    def _render(self, cameras: Sequence[Handle], **options: Any) -> list[Frame]:
        mine: list[Callable[[], None]] = []

        def started(cancel: Callable[[], None]) -> None:
            mine.append(cancel)
            self._cancels.add(cancel)
            if self._stopped:
                cancel()

        try:
            frames: list[Frame] = self.scene.render(
                cameras, revision=self.revision, progress=False, on_start=started, **options
            )
            return frames
        finally:
            self._cancels.difference_update(mine)
