"""heliograph.torch: frames of a daemon as a PyTorch data set, rendered while the network learns.

    frames = ht.Frames(scene, "cam", randomizer, count=1000, planes=["beauty", "depth"], spp=16)
    for batch in ht.loader(frames, batch_size=8, num_workers=2):
        loss = network(batch["beauty"].cuda(non_blocking=True), batch["labels"])

Image i is that of heliograph.datasets.generate with the same seed: it depends only on (seed, i).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from multiprocessing.util import Finalize
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import distributed
from torch.utils import data

from .datasets._deal import dealt
from .datasets._prefetch import in_order
from .datasets.source import Source, naming
from .datasets.writer import Image
from .errors import HeliographError, InvalidArgument
from .scene.handles import Named, flatten
from .values.checks import whole_of

if TYPE_CHECKING:
    from .client.scene import Scene

_OWN = ("overlay", "revision", "progress", "on_pass", "on_start", "timeout")
_SOURCE = ("accept", "attempts")


class Frames(data.IterableDataset):  # type: ignore[misc,unused-ignore]
    """Images drawn from a scene: an IterableDataset of the results of `item`.

    Image i is drawn from (seed, i) alone, as generate() does it: of draw i // C seen by camera
    i % C of C. It is rendered on a branch of the scene as it was when Frames was made, so that
    edits meanwhile change nothing. This process keeps that branch, `scene`, as long as it has these
    Frames or a loader of them.

    camera: one, or a sequence. randomizer: a callable (draw) -> None, see heliograph.datasets; it
    runs in one thread of each worker. count: how many images; None: without end. start: the first
    one's index; a training that goes on after n images sets start=n. ahead: images under way, in
    each worker, while one is handed over. item: makes an item of a datasets.Image; default
    tensors(). block: so many consecutive images come of one worker; a loader() takes the size of a
    batch. rank, ranks: which share is of this process; default that of torch.distributed where it
    is initialized. All ranks have as many blocks; images that do not go round are left out.
    options: accept and attempts of generate(); planes, labels, spp and others of Scene.render. With
    device="cuda" tensors stay on the GPU that rendered them, in this process.

    An error of image i names it in its message.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Named | Sequence[Named],
        randomizer: Callable[[Any], Any],
        *,
        count: int | None = None,
        start: int = 0,
        seed: int = 0,
        ahead: int = 2,
        item: Callable[[Image], Any] | None = None,
        block: int = 1,
        rank: int | None = None,
        ranks: int | None = None,
        **options: Any,
    ) -> None:
        super().__init__()
        refused = sorted(set(options) & set(_OWN))
        if refused:
            raise InvalidArgument(f"{refused[0]}: Frames sets it", field=refused[0])
        self.cameras = flatten(camera, "camera")
        self.randomizer = randomizer
        self.count = None if count is None else whole_of(count, "count", 0)
        self.start = whole_of(start, "start", 0)
        self.seed = whole_of(seed, "seed", 0, 2**64 - 1)
        self.ahead = whole_of(ahead, "ahead", 0)
        self.item = item or tensors
        self.block = whole_of(block, "block", 1)
        self.rank, self.ranks = _share(rank, ranks)
        self.options = {"planes": ["beauty"], "labels": True, **options}
        self.scene = scene.branch()
        Finalize(self.scene, _delete, (copy(self.scene),))  # in this process alone

    def __len__(self) -> int:
        """Number of images of this rank. TypeError without a count."""
        if self.count is None:
            raise TypeError("Frames without count= have no length")
        return sum(1 for _ in self.indices())

    def indices(self, worker: int = 0, workers: int = 1) -> Iterator[int]:
        """Yields the indices of the images of one of this rank's workers, in order."""
        count = self.count
        if count is not None and self.ranks > 1:
            count -= count % (self.block * self.ranks)
        part, parts = self.rank + self.ranks * worker, self.ranks * workers
        return dealt(count, part, parts, block=self.block, start=self.start)

    def __iter__(self) -> Iterator[Any]:
        info = data.get_worker_info()
        if info is None:
            return self._items(0, 1)
        if self.options.get("device") == "cuda":
            raise InvalidArgument(
                "device: frames on a GPU cannot leave a worker; use num_workers=0, as Frames "
                "render ahead by themselves, or device='cpu' with pin_memory=True",
                field="device",
            )
        return self._items(info.id, info.num_workers)

    def _items(self, worker: int, workers: int) -> Iterator[Any]:
        branch = self.scene.branch()
        source = _Source(self, branch)
        items = in_order(self.indices(worker, workers), source.drawn, source.item, self.ahead)
        # A worker that has to end does not close its generators.
        end = Finalize(None, _end, (source, items, branch), exitpriority=0)
        try:
            yield from items
        finally:
            end()


def _end(source: _Source, items: Generator[Any, None, None], branch: Scene) -> None:
    source.stop()
    items.close()
    _delete(branch)


def _delete(branch: Scene) -> None:
    if not branch.client.connection.closed:
        with suppress(HeliographError):  # it ends with the session, too
            branch.delete()


class _Source(Source):
    """The items of some Frames."""

    def __init__(self, frames: Frames, branch: Scene) -> None:
        options = dict(frames.options)
        self._asked = {name: options.pop(name) for name in ("planes", "labels")}
        self._item = frames.item
        super().__init__(
            branch,
            frames.cameras,
            frames.randomizer,
            seed=frames.seed,
            labels=self._asked["labels"],
            **{name: options.pop(name) for name in _SOURCE if name in options},
            options=options,
        )

    def drawn(self, index: int) -> tuple[int, Any]:
        """(index, overlay) of an image."""
        with naming(index):
            return index, self.draw(index // len(self.cameras)).edit

    def item(self, drawn: tuple[int, Any]) -> Any:
        """Renders an image and returns the result of the `item` function."""
        index, edit = drawn
        draw, camera = divmod(index, len(self.cameras))
        with naming(index):
            frames = self.frames(draw, edit, [self.cameras[camera]], **self._asked)
            return self._item(Image(index, frames[0]))


def _share(rank: int | None, ranks: int | None) -> tuple[int, int]:
    if (rank is None) != (ranks is None):
        raise InvalidArgument("rank: goes with ranks, give both", field="rank")
    if rank is None:
        if distributed.is_available() and distributed.is_initialized():
            return distributed.get_rank(), distributed.get_world_size()
        return 0, 1
    total = whole_of(ranks, "ranks", 1)
    return whole_of(rank, "rank", 0, total - 1), total


def tensors(image: Image) -> dict[str, Any]:
    """An image as tensors of their own: each plane (C, H, W) or (H, W), "index", "K" (3, 3) and
    "camera_from_world_cv" (4, 4) float32, and "labels", its columns by name: (N, ...), names as a
    list of str. uint32 and uint64, which PyTorch hardly knows, become int64. Planes of a frame on a
    GPU stay there."""
    frame = image.frame
    out: dict[str, Any] = {"index": image.index}
    for plane in frame:
        found = frame._find(plane)
        tensor = _tensor(found) if isinstance(found, np.ndarray) else _widened(found.torch())
        out[plane] = tensor.movedim(-1, 0).contiguous() if tensor.ndim == 3 else tensor
    for name in ("K", "camera_from_world_cv"):
        out[name] = torch.from_numpy(getattr(frame, name).astype(np.float32))
    labels = frame.labels
    out["labels"] = {
        name: _tensor(labels[name]) if isinstance(labels[name], np.ndarray) else labels[name]
        for name in labels
    }
    return out


def _tensor(array: Any) -> Any:
    is_wide = array.dtype.kind == "u" and array.dtype.itemsize > 1
    return torch.from_numpy(array.astype(np.int64 if is_wide else array.dtype))


def _widened(tensor: Any) -> Any:
    is_wide = not tensor.is_floating_point() and tensor.dtype != torch.uint8
    return tensor.to(torch.int64) if is_wide else tensor.clone()


def collate(items: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A batch of tensors()'s items: planes, K and poses stacked as (B, ...), "index" (B,) int64,
    and "labels" a list of the B images' columns, as each has instances of its own number."""
    out: dict[str, Any] = {}
    for name in items[0]:
        column = [item[name] for item in items]
        out[name] = column if name == "labels" else data.default_collate(column)
    return out


def loader(frames: Frames, batch_size: int = 1, **options: Any) -> Any:
    """A torch.utils.data.DataLoader of batches of `frames`, the same ones for any num_workers.

    options: of DataLoader: num_workers, pin_memory, multiprocessing_context ("spawn" where the
    process has used a GPU or threads that do not stand a fork), ...; collate_fn is collate().
    """
    frames = copy(frames)
    frames.block = whole_of(batch_size, "batch_size", 1)
    return data.DataLoader(frames, batch_size, **{"collate_fn": collate, **options})
