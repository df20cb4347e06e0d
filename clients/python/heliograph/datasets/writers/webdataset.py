"""WebDataset: tar files of many images each, for readers that stream.

Format: https://github.com/webdataset/webdataset: files of one sample stand one after another and
share their name up to the first dot; tar by POSIX.1-1988 (ustar).
"""

from __future__ import annotations

import io
import json
import os
import tarfile
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ...components import whole_of
from ...errors import FailedPrecondition
from ..folder import NAME
from ..writer import Image, Picture, Records, Writer
from .exr import labels_of

_END = bytes(1024)  # two empty blocks


class WebDataset(Writer):
    """DIR/000000.tar, 000001.tar ...; with splits train-000000.tar ...

    A sample has 000123.png, 000123.json (as that of hd.Exr, but for planes) and 000123.PLANE.npy of
    each plane asked for. shard_size: samples a tar. The same data set has the same bytes: members
    have no time and no owner. Until the last image is made, samples wait in DIR/.heliograph/parts.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        planes: Sequence[str] = (),
        labels: Any = True,
        shard_size: int = 1000,
        picture: Picture | str | None = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.arrays = list(planes)
        self.planes = tuple(dict.fromkeys((*planes, *self.picture_planes)))
        self.labels = labels
        self.shard_size = whole_of(shard_size, "shard_size", 1)

    def write(self, image: Image) -> Any:
        part = io.BytesIO()
        if self.picture is not None:
            data = self.picture.encode(image.frame)
            part.write(member(f"{image.name}.{self.picture.format}", data))
        text = json.dumps(labels_of(self.dataset, image), allow_nan=False)
        part.write(member(f"{image.name}.json", text.encode()))
        for plane in self.arrays:
            array = io.BytesIO()
            np.save(array, np.ascontiguousarray(image.frame[plane]), allow_pickle=False)
            part.write(member(f"{image.name}.{plane.replace(':', '_')}.npy", array.getvalue()))
        self.put(_part(image.index), part.getvalue())
        return {"bytes": part.tell()}

    def finish(self, records: Records) -> None:
        for split in self.dataset.splits or ("",):
            numbered = enumerate(records.of_split(split))
            for shard, rows in groupby(numbered, lambda row: row[0] // self.shard_size):
                name = f"{split}-{shard:06d}.tar" if split else f"{shard:06d}.tar"
                self._put_shard(name, [(index, record["bytes"]) for _, (index, record) in rows])

    def _put_shard(self, name: str, samples: list[tuple[int, int]]) -> None:
        """Moves samples to their shard. Those that are not in parts are in it already, first."""
        parts = [self.directory / _part(index) for index, _ in samples]
        there = next((i for i, part in enumerate(parts) if part.exists()), len(parts))
        size = sum(size for _, size in samples[:there])
        old = self.directory / name
        if there and (not old.exists() or old.stat().st_size < size + len(_END)):
            raise FailedPrecondition(
                f"{old} lacks images that were in it: make them again with resume=False"
            )
        if there == len(parts) and old.stat().st_size == size + len(_END):
            return
        with self.file(name) as path, open(path, "wb") as out:
            if there:
                with open(old, "rb") as before:
                    _copy(before, out, size)
            for part in parts[there:]:
                with open(part, "rb") as sample:
                    _copy(sample, out, part.stat().st_size)
            out.write(_END)
        for part in parts[there:]:
            part.unlink()


def _part(index: int) -> Path:
    return Path(NAME) / "parts" / f"{index:06d}.tar"


def _copy(source: Any, target: Any, size: int) -> None:
    for start in range(0, size, 1 << 20):
        target.write(source.read(min(1 << 20, size - start)))


def member(name: str, data: bytes) -> bytes:
    """A file of a tar: header, bytes, and zeros up to a multiple of 512."""
    info = tarfile.TarInfo(name)
    info.size = len(data)
    return info.tobuf(tarfile.USTAR_FORMAT) + data + bytes(-len(data) % tarfile.BLOCKSIZE)
