"""WebDataset: tar files of samples.

Format: https://github.com/webdataset/webdataset, "The WebDataset Format": files of a sample share
their name up to the first dot and stand one after another.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from . import frame_labels, frame_planes
from .exr import check_frame, wrong_content
from .files import batches, files, wanted_count
from .formats import Format, Task
from .report import Faults, Malformed

CHECKS = {
    "format": "tar files can be read, .json, .png, .jpg and .npy in them, too",
    "members": "members are files called KEY.ENDING, those of a sample one after another",
    "endings": "every sample has the same endings",
    "keys": "a key is there once, over all shards, and is the index of its JSON",
    "pictures": "a picture has width and height of its JSON",
    "counts": "shards are numbered from 0, all but the last one of one length; as many samples as "
    "images asked for",
    **frame_labels.CHECKS,
    **frame_planes.CHECKS,
}


@dataclass
class _Sample:
    """Sample of a shard. members: ending to (offset, size), bytes."""

    key: str
    members: dict[str, tuple[int, int]] = field(default_factory=dict)


def found(root: Path) -> bool:
    return next(files(root, ".tar"), None) is not None


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    keys: dict[str, str] = {}
    endings: set[str] = set()
    lengths: dict[str, list[tuple[str, int]]] = {}
    for path in files(root, ".tar"):
        samples = _read_index(path, faults)
        for sample in samples:
            if sample.key in keys:
                faults.add("keys", path, f"{sample.key} is in {keys[sample.key]}, too: once a set")
            keys[sample.key] = path.name
            endings = endings or set(sample.members)
            if set(sample.members) != endings:
                differs = ", ".join(sorted(set(sample.members) ^ endings))
                faults.add(
                    "endings", path, f"{sample.key} differs from the first sample by {differs}"
                )
        split, _, number = path.stem.rpartition("-")
        lengths.setdefault(split, []).append((number, len(samples)))
        for batch in batches(samples, 8):
            yield partial(check_samples, path, batch)
    _check_shards(root, lengths, faults)
    wanted = wanted_count(root)
    if wanted is not None and len(keys) != wanted:
        faults.add("counts", root, f"has {len(keys)} samples, and the data set {wanted} images")


def _read_index(path: Path, faults: Faults) -> list[_Sample]:
    samples: list[_Sample] = []
    try:
        with tarfile.open(path) as archive:
            for member in archive:
                key, dot, ending = member.name.rpartition("/")[2].partition(".")
                folder = member.name.rpartition("/")[0]
                key = f"{folder}/{key}" if folder else key
                if not member.isfile() or not dot or not key:
                    faults.add("members", path, f"{member.name}: needs a file called KEY.ENDING")
                    continue
                if not samples or samples[-1].key != key:
                    if any(sample.key == key for sample in samples):
                        faults.add("members", path, f"{member.name} is away from its sample")
                        continue
                    samples.append(_Sample(key))
                samples[-1].members[ending] = (member.offset_data, member.size)
    except (tarfile.TarError, OSError) as error:
        raise Malformed(path, f"is no tar that can be read ({error}): write it anew") from None
    return samples


def _check_shards(root: Path, lengths: dict[str, list[tuple[str, int]]], faults: Faults) -> None:
    for split, shards in lengths.items():
        name = split or "the set"
        numbers = [number for number, _ in shards]
        if numbers != [f"{i:06d}" for i in range(len(shards))]:
            faults.add("counts", root, f"{name} has shards {numbers[:9]}: needs 000000, 000001 ...")
        odd = [number for number, count in shards[:-1] if count != shards[0][1]]
        if odd:
            faults.add(
                "counts",
                root,
                f"shard {odd[0]} of {name} is not as long as the first: only the last",
            )
        if shards[-1][1] > shards[0][1] or not shards[-1][1]:
            faults.add("counts", root, f"the last shard of {name} has {shards[-1][1]} samples")


def check_samples(path: Path, samples: list[_Sample], faults: Faults) -> None:
    """Some samples of a shard."""
    with open(path, "rb") as file:
        for sample in samples:
            contents: dict[str, Any] = {}
            for ending, (offset, size) in sample.members.items():
                file.seek(offset)
                try:
                    contents[ending] = _decoded(ending, file.read(size))
                except (OSError, ValueError, SyntaxError, EOFError) as error:
                    faults.add("format", path, f"{sample.key}.{ending} cannot be read ({error})")
                    return
            _check_sample(path, sample.key, contents, faults)


def _decoded(ending: str, data: bytes) -> Any:
    """JSON's content, an array, a picture's size; None of others."""
    last = ending.rpartition(".")[2]
    if last == "json":
        return json.loads(data)
    if last == "npy":
        return np.load(io.BytesIO(data), allow_pickle=False)
    if last in ("png", "jpg", "jpeg"):
        from PIL import Image

        with Image.open(io.BytesIO(data)) as picture:
            picture.load()
            return picture.size
    return None


def _check_sample(path: Path, key: str, contents: dict[str, Any], faults: Faults) -> None:
    content = contents.get("json")
    if content is None:
        return
    if not isinstance(content, dict):
        faults.add("format", path, f"{key}.json holds a {type(content).__name__}: needs an object")
        return
    index = content.get("index")
    if index is not None and key.isdigit() and int(key) != index:
        faults.add("keys", path, f"{key}.json has index {index}: needs {int(key)}")
    if not {"width", "height", "K", "instances"} <= set(content):
        return  # of other makers
    wrong = wrong_content(content)
    if wrong:
        faults.add("format", path, f"{key}.json {wrong}")
        return
    for ending, size in contents.items():
        if isinstance(size, tuple) and size != (content["width"], content["height"]):
            named = f"{content['width']}x{content['height']}"
            faults.add("pictures", path, f"{key}.{ending} is {size[0]}x{size[1]}, its JSON {named}")
    planes = {
        ending[: -len(".npy")]: array
        for ending, array in contents.items()
        if isinstance(array, np.ndarray) and array.ndim in (2, 3)
    }
    check_frame(planes, content, path, faults)


FORMAT = Format("webdataset", "WebDataset", "*.tar", CHECKS, found, tasks)
