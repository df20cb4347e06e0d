"""What a data set keeps about itself in DIR/.heliograph. Used by generate() and commands."""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import hashlib
import json
import os
import re
import shutil
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import FailedPrecondition, NotFound, ResourceExhausted

if TYPE_CHECKING:
    from ..scene import Scene

NAME = ".heliograph"
FORMAT = "heliograph.dataset.v1"
_HOST = socket.gethostname()
_PARTIAL = re.compile(rf"{re.escape(_HOST)}-(\d+)-\d+-[^-]+")
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST)


class Folder:
    """DIR and its DIR/.heliograph: dataset.json, scene.helio, records/000123.json (what the writer
    returned, with what is needed to check a picture), manifests/000123.json, overlays/000123.bin
    (a v1.Transaction) where the manifest has not got it; of what overlays name by SHA-256
    blobs/SHA256, and decodings/SHA256.bin (a v1.DecodeAssetRequest, whose files are blobs) where
    the daemon made it of files. Thread: any.

    Each file appears whole or not at all. The record comes last: with it the image is done.
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root)
        self.own = self.root / NAME
        self.scene_path = self.own / "scene.helio"

    @contextlib.contextmanager
    def finishing(self) -> Iterator[None]:
        """Alone among the processes of this machine: two may have made the last images."""
        with self._explained("finish.lock"), open(self.own / "finish.lock", "w") as lock:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(lock.fileno(), msvcrt.LK_LOCK, 1)
            else:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    @contextlib.contextmanager
    def file(self, name: str | Path) -> Iterator[Path]:
        """A path to write to, which becomes DIR/name when the block ends without an exception."""
        final = self.root / name
        partial = self.own / "partial"
        end = final.name.replace("-", "_")  # so that no host passes for another
        path = partial / f"{_HOST}-{os.getpid()}-{threading.get_ident()}-{end}"
        with self._explained(name):
            partial.mkdir(parents=True, exist_ok=True)
            try:
                yield path
                final.parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, final)
            finally:
                path.unlink(missing_ok=True)

    def put(self, name: str | Path, data: bytes | str) -> None:
        """Writes DIR/name."""
        with self.file(name) as path:
            path.write_bytes(data.encode() if isinstance(data, str) else data)

    @contextlib.contextmanager
    def _explained(self, name: str | Path) -> Iterator[None]:
        """Says what to do where a disk is full or closed, also of libraries that tell it in words
        of their own."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            path = self.root / name
            if _is_of(error, _FULL):
                raise ResourceExhausted(
                    f"{path}: cannot be written ({error}): make room there and call generate() "
                    "again; images that are done stay"
                ) from error
            if _is_of(error, _CLOSED):
                raise FailedPrecondition(
                    f"{path}: cannot be written ({error}): name a directory that this user may "
                    "write to"
                ) from error
            raise

    # ------------------------------------------------------------ images

    def _record(self, index: int) -> Path:
        return self.own / "records" / f"{name_of(index)}.json"

    def has(self, index: int) -> bool:
        return self._record(index).exists()

    def keep(self, index: int, record: dict[str, Any], manifest: str, overlay: bytes) -> None:
        """Notes that an image is done. Of a large overlay the manifest has a hash alone."""
        if overlay and '"overlay":{' not in manifest:
            self.put(f"{NAME}/overlays/{name_of(index)}.bin", overlay)
        self.put(f"{NAME}/manifests/{name_of(index)}.json", manifest)
        text = json.dumps(record, separators=(",", ":"), allow_nan=False)
        self.put(self._record(index).relative_to(self.root), text)

    def record(self, index: int) -> dict[str, Any]:
        """What keep() got; NotFound."""
        return _json(self._record(index))

    def manifest(self, index: int) -> str:
        """What keep() got; NotFound."""
        return _text(self.own / "manifests" / f"{name_of(index)}.json")

    def overlay(self, index: int) -> bytes | None:
        """What keep() got, where the manifest has not got it."""
        path = self.own / "overlays" / f"{name_of(index)}.bin"
        return path.read_bytes() if path.exists() else None

    def has_blob(self, digest: bytes) -> bool:
        return self._blob(digest).exists()

    def keep_blob(self, digest: bytes, data: bytes) -> None:
        """Notes bytes by their SHA-256, once."""
        if not self.has_blob(digest):
            self.put(self._blob(digest).relative_to(self.root), data)

    def blob(self, digest: bytes) -> bytes | None:
        """What keep_blob() got."""
        path = self._blob(digest)
        return path.read_bytes() if path.exists() else None

    def keep_decoding(self, digest: bytes, request: bytes) -> None:
        """Notes what was decoded to what that SHA-256 names, once."""
        path = self._decoding(digest)
        if not path.exists():
            self.put(path.relative_to(self.root), request)

    def decoding(self, digest: bytes) -> bytes | None:
        """What keep_decoding() got."""
        path = self._decoding(digest)
        return path.read_bytes() if path.exists() else None

    def _blob(self, digest: bytes) -> Path:
        return self.own / "blobs" / digest.hex()

    def _decoding(self, digest: bytes) -> Path:
        return self.own / "decodings" / f"{digest.hex()}.bin"

    # ------------------------------------------------------------ the data set

    @property
    def description(self) -> dict[str, Any]:
        """dataset.json; NotFound where there is none."""
        return _json(self.own / "dataset.json")

    def open(self, description: dict[str, Any], scene: Scene, resume: bool) -> None:
        """Begins a data set, or goes on with one if it is the same; one without an image yet may
        become another. resume: its images stay. If not, another one is refused too where it has
        files: they would be among the new ones."""
        with self._explained(NAME):
            self.own.mkdir(parents=True, exist_ok=True)
            self._drop_partial()
        with self.file(self.scene_path.relative_to(self.root)) as path:
            scene.save(path)
            description = {"format": FORMAT, **description, "scene_sha256": _sha256(path)}
            begun = self._has_files() or (resume and self._has_images())
            if begun and (self.own / "dataset.json").exists():
                self._check(description)
            if not resume:
                self._forget()
        text = json.dumps(description, indent=1, default=_plain) + "\n"
        self.put(f"{NAME}/dataset.json", text)

    def _has_files(self) -> bool:
        return any(path != self.own for path in self.root.iterdir())

    def _has_images(self) -> bool:
        return any(path.is_file() for path in (self.own / "records").rglob("*"))

    def _forget(self) -> None:
        for name in ("shards", "records", "manifests", "overlays", "blobs", "decodings", "parts"):
            shutil.rmtree(self.own / name, ignore_errors=True)

    def _drop_partial(self) -> None:
        """What processes of this machine left that were killed."""
        for path in (self.own / "partial").glob("*"):
            mine = _PARTIAL.fullmatch(path.name)
            if mine and not _is_alive(int(mine[1])):
                path.unlink(missing_ok=True)

    def _check(self, description: dict[str, Any]) -> None:
        """More images of the same data set are the same data set."""
        old = self.description
        new = json.loads(json.dumps(description, default=_plain))
        differs = [
            key.removesuffix("_sha256")
            for key in _differences(old, new)
            if key not in ("count", "version", "numpy")
        ]
        if description["count"] < old["count"]:
            raise FailedPrecondition(
                f"{self.root} is a data set of {old['count']} images, count={description['count']} "
                "is less: ask for as many or more, or remove the directory"
            )
        if differs:
            raise FailedPrecondition(
                f"{self.root} is a data set with another {', '.join(differs)}: write to another "
                "directory, or remove this one"
            )


def _differences(old: dict[str, Any], new: dict[str, Any]) -> Iterator[str]:
    """Keys with another value; of two objects in them "key.inner"."""
    for key in sorted({*old, *new}):
        a, b = old.get(key), new.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            yield from (f"{key}.{inner}" for inner in _differences(a, b))
        elif a != b:
            yield key


def _is_of(error: Exception, numbers: tuple[int, ...]) -> bool:
    """Whether an error is one of these, by its number or by what it says."""
    told = getattr(error, "errno", None)
    return told in numbers or (
        told is None and any(os.strerror(number) in str(error) for number in numbers)
    )


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _is_alive(process: int) -> bool:
    if sys.platform == "win32":
        return True  # what asks elsewhere, os.kill(process, 0), ends it there
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def name_of(index: int) -> str:
    """ "000123": what the files of an image are called."""
    return f"{index:06d}"


def _plain(value: Any) -> Any:
    """What JSON has no word for."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return repr(value)


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except FileNotFoundError:
        raise NotFound(
            f"{path} is not there: no finished image of a data set that generate() made"
        ) from None


def _json(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(_text(path))
    except ValueError as error:
        raise FailedPrecondition(
            f"{path}: is torn ({error}): remove it, and call generate() again"
        ) from None
    return found
