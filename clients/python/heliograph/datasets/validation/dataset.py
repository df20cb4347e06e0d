"""What generate() keeps about a data set in DIR/.heliograph, read as files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from google.protobuf.message import DecodeError

from ..._proto import service_pb2 as service
from .files import OWN, batches, files, read_object
from .formats import Format, Task
from .report import Faults, Malformed

CHECKS = {
    "format": "dataset.json and every record are JSON objects",
    "counts": "a record and a manifest of each image asked for, and of no other",
    "kept": "scene.helio and blobs have the SHA-256 of dataset.json and of their names, decodings "
    "the blobs of their files",
    "partial": "no file was left half written",
}


def wanted_count(root: Path) -> int | None:
    """How many images the data set was to have, None where dataset.json does not say."""
    path = root / OWN / "dataset.json"
    if not path.is_file():
        return None
    count = read_object(path).get("count")
    if not isinstance(count, int):
        raise Malformed(path, f"count is {count!r}: needs a whole number")
    return count


def found(root: Path) -> bool:
    return (root / OWN / "dataset.json").is_file()


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = wanted_count(root)
    if count is None:
        raise Malformed(root / OWN / "dataset.json", "is not there: generate() writes it")
    names = [f"{index:06d}.json" for index in range(count)]
    for folder in ("records", "manifests"):
        own = root / OWN / folder
        there = {path.name for path in own.iterdir()} if own.is_dir() else set()
        missing = [name for name in names if name not in there]
        extra = sorted(there.difference(names))
        if missing:
            faults.add(
                "counts",
                own,
                f"{len(missing)} of {count} are missing, the first is {missing[0]}: call "
                "generate() again, it makes what is missing",
            )
        if extra:
            faults.add("counts", own, f"{extra[0]} is beyond the {count} images: remove it")
    partial_files = root / OWN / "partial"
    for left in sorted(partial_files.iterdir()) if partial_files.is_dir() else ():
        faults.add("partial", left, "was left by a run that was killed: remove it")
    for batch in batches(names, 256):
        yield partial(check_records, root / OWN / "records", batch)
    yield partial(check_scene, root / OWN)
    for batch in batches(files(root / OWN / "blobs", ""), 16):
        yield partial(check_blobs, batch)
    for batch in batches(files(root / OWN / "decodings", ".bin"), 256):
        yield partial(check_decodings, root / OWN / "blobs", batch)


def check_records(folder: Path, names: list[str], faults: Faults) -> None:
    """Are they JSON objects?"""
    for name in names:
        if (folder / name).is_file():
            read_object(folder / name)


def check_scene(folder: Path, faults: Faults) -> None:
    """The scene that rerender starts from."""
    told = read_object(folder / "dataset.json").get("scene_sha256")
    if told is not None:
        _check_bytes(folder / "scene.helio", told, faults)


def check_blobs(paths: list[Path], faults: Faults) -> None:
    """Some arrays and files that overlays name."""
    for path in paths:
        _check_bytes(path, path.name, faults)


def _check_bytes(path: Path, told: str, faults: Faults) -> None:
    digest = hashlib.sha256()
    if not path.is_file():
        faults.add("kept", path, "is not there, and images are rendered again from it: copy it")
        return
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    if digest.hexdigest() != told:
        faults.add("kept", path, f"has the SHA-256 {digest.hexdigest()}, not {told}: copy it anew")


def check_decodings(blobs: Path, paths: list[Path], faults: Faults) -> None:
    """What the daemon decoded for overlays: requests whose files are blobs."""
    for path in paths:
        try:
            request = service.DecodeAssetRequest.FromString(path.read_bytes())
        except DecodeError as error:
            raise Malformed(path, f"is no v1.DecodeAssetRequest ({error}): copy it anew") from None
        for file in request.files:
            if not (blobs / file.sha256.hex()).is_file():
                faults.add("kept", path, f"needs blobs/{file.sha256.hex()}, {file.path}: copy it")


FORMAT = Format("dataset", "what generate() keeps", f"{OWN}/dataset.json", CHECKS, found, tasks)
