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
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import FailedPrecondition
from ...values.checks import whole_of
from ..folder import NAME, name_of
from ..writer import Image, Picture, Records, Writer
from .exr import labels_of

_END = bytes(1024)  # two empty blocks


class WebDataset(Writer):
    """DIR/000000.tar, 000001.tar ...; with splits train-000000.tar ...

    A sample has 000123.png, 000123.json (as that of hd.Exr, but for planes) and 000123.PLANE.npy of
    each plane asked for. shard_size: samples per tar. The same data set has the same bytes: members
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
        """Moves samples to their shard. Samples that are not in parts are in it already."""
        old, total = self.directory / name, sum(size for _, size in samples) + len(_END)
        parts = {i: part for i, _ in samples if (part := self.directory / _part(i)).exists()}
        if not parts and old.exists() and old.stat().st_size == total:
            return
        places = _places_in(old) if len(parts) < len(samples) else {}
        starts = {i: places.get((name_of(i), size)) for i, size in samples if i not in parts}
        if None in starts.values():
            raise FailedPrecondition(
                f"{old} lacks images that were in it: make them again with resume=False"
            )
        with self.file(name) as path, open(path, "wb") as out:
            for i, size in samples:
                with open(parts.get(i, old), "rb") as source:
                    source.seek(starts.get(i) or 0)
                    _copy(source, out, size)
            out.write(_END)
        for part in parts.values():
            part.unlink()


def _places_in(shard: Path) -> dict[tuple[str, int], int]:
    """(name, bytes) to offset of the samples that are whole in a shard."""
    places = {}
    with suppress(FileNotFoundError, tarfile.ReadError), tarfile.open(shard, "r:") as tar:
        for name, group in groupby(tar, lambda member: member.name.partition(".")[0]):
            members = list(group)
            start, last = members[0].offset, members[-1]
            end = last.offset_data + last.size + -last.size % tarfile.BLOCKSIZE
            places[name, end - start] = start
    return places


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
