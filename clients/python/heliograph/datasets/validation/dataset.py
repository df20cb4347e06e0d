"""Checks of DIR/.heliograph, where generate() keeps records of a data set, read as files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from ..._wire._proto import service_pb2 as service
from .files import OWN, batches, files, read_object, wanted_count
from .formats import Format, Task
from .report import Faults, Malformed
from .written import WRITTEN

CHECKS = {
    "format": "dataset.json and every record are JSON objects",
    "counts": "a record and a manifest of each image asked for, and of no other",
    "files": "of a data set with all its images, the files of the format that dataset.json names",
    "kept": "scene.helio and blobs have the SHA-256 of dataset.json and of their names, decodings "
    "the blobs of their files",
    "partial": "no file was left half written",
}
_NAMES = {"Middlebury": "flo", "NerfTransforms": "nerf"}  # where it is not the writer's, in small


def found(root: Path) -> bool:
    return (root / OWN / "dataset.json").is_file()


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = wanted_count(root)
    if count is None:
        raise Malformed(root / OWN / "dataset.json", "is not there: generate() writes it")
    names = [f"{index:06d}.json" for index in range(count)]
    check_counts(root / OWN, names, faults)
    partial_files = root / OWN / "partial"
    for left in sorted(partial_files.iterdir()) if partial_files.is_dir() else ():
        faults.add(
            "partial",
            left,
            "is of a run under way, or of a killed one: the next one on its machine removes it",
        )
    for batch in batches(names, 256):
        yield partial(check_records, root / OWN / "records", batch)
    yield partial(check_scene, root / OWN)
    for batch in batches(files(root / OWN / "blobs", ""), 16):
        yield partial(check_blobs, batch)
    for batch in batches(files(root / OWN / "decodings", ".bin"), 256):
        yield partial(check_decodings, root / OWN / "blobs", batch)


def check_counts(own: Path, names: list[str], faults: Faults) -> None:
    """Checks that all images are there, and, if they are, the format's files."""
    format_name = _format_of(own)
    made, described = _listed(own / "records"), _listed(own / "manifests")
    missing = [name for name in names if name not in made]
    bare = [name for name in names if name in made and name not in described]
    if missing:
        a_set = f" of a {format_name} set" if format_name else ""
        faults.add(
            "counts",
            own,
            f"{len(names) - len(missing)} of {len(names)} images{a_set} are there, the first that "
            f"is missing is {Path(missing[0]).stem}: call generate() again with the same "
            "arguments, it makes the missing ones",
        )
    elif format_name:
        _check_files(own.parent, format_name, faults)
    if bare:
        faults.add(
            "counts",
            own / "manifests",
            f"{len(bare)} of {len(made)} are missing, the first is {bare[0]}: remove their records "
            "and call generate() again",
        )
    for folder, there in (("records", made), ("manifests", described)):
        for name in sorted(there.difference(names))[:1]:
            beyond = f"{name} is beyond the {len(names)} images: remove it"
            faults.add("counts", own / folder, beyond)


def _listed(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.is_dir() else set()


def _format_of(own: Path) -> str:
    """The writer that made it, "" where dataset.json names none."""
    writer: Any = read_object(own / "dataset.json").get("writer")
    return str(writer.get("format", "")) if isinstance(writer, dict) else ""


def _check_files(root: Path, format_name: str, faults: Faults) -> None:
    named = WRITTEN.get(_NAMES.get(format_name, format_name.lower()))
    if named is not None and not named.found(root):
        faults.add(
            "files",
            root,
            f"all images of a {format_name} set are done, and its files are not there, such as "
            f"{named.looks_for}: copy them, or call generate() again, which writes those of the "
            "whole set; with resume=False all",
        )
    elif named is None and not any(one.found(root) for one in WRITTEN.values()):
        faults.leave("files", f"{format_name} is no format that validate() knows")


def check_records(folder: Path, names: list[str], faults: Faults) -> None:
    """Are they JSON objects?"""
    for name in names:
        if (folder / name).is_file():
            read_object(folder / name)


def check_scene(folder: Path, faults: Faults) -> None:
    """The scene that rerender starts from."""
    expected = read_object(folder / "dataset.json").get("scene_sha256")
    if expected is not None:
        _check_bytes(folder / "scene.helio", expected, faults)


def check_blobs(paths: list[Path], faults: Faults) -> None:
    """Some arrays and files that overlays name."""
    for path in paths:
        _check_bytes(path, path.name, faults)


def _check_bytes(path: Path, expected: str, faults: Faults) -> None:
    digest = hashlib.sha256()
    if not path.is_file():
        faults.add("kept", path, "is not there, and images are rendered again from it: copy it")
        return
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    if digest.hexdigest() != expected:
        faults.add(
            "kept", path, f"has the SHA-256 {digest.hexdigest()}, not {expected}: copy it anew"
        )


def check_decodings(blobs: Path, paths: list[Path], faults: Faults) -> None:
    """Checks the kept requests of decodings: each file that they name is a blob."""
    for path in paths:
        try:
            request = service.DecodeAssetRequest.FromString(path.read_bytes())
        except DecodeError as error:
            raise Malformed(path, f"is no v1.DecodeAssetRequest ({error}): copy it anew") from None
        for file in request.files:
            if not (blobs / file.sha256.hex()).is_file():
                faults.add("kept", path, f"needs blobs/{file.sha256.hex()}, {file.path}: copy it")


FORMAT = Format("dataset", "what generate() keeps", f"{OWN}/dataset.json", CHECKS, found, tasks)
