"""Folder DIR/.heliograph, where a data set keeps records. Used by generate() and commands;
dataset.json is in record.py."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import socket
import sys
import threading
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

from ..errors import FailedPrecondition, NotFound, ResourceExhausted

NAME = ".heliograph"


def _here() -> str:
    """Name of this process namespace: containers may share a host's name, not this."""
    try:
        return f"{socket.gethostname()}-{os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:  # no Linux
        return socket.gethostname()


_HERE = _here()
_MINE = re.compile(rf"{re.escape(_HERE)}-(\d+)-\d+-[^-]+")
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EEXIST)


class Folder:
    """DIR and its DIR/.heliograph: dataset.json, scene.helio, records/000123.json (the record of
    the writer, and values to check a picture by), manifests/000123.json, overlays/000123.bin (a
    v1.Transaction) where the manifest leaves it out; blobs/SHA256 that overlays name by hash, and
    decodings/SHA256.bin (a v1.DecodeAssetRequest, whose files are blobs) where the daemon made the
    bytes of files. Thread: any.

    Each file appears whole or not at all. The record comes last: with it the image is done.
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root).absolute()  # os.chdir() moves no data set
        self.own = self.root / NAME
        self.scene_path = self.own / "scene.helio"

    # ------------------------------------------------------------ among others

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Alone among the processes of this machine, and of others where the file system has locks
        between machines."""
        with contextlib.ExitStack() as stack:
            with self.explained("lock"):
                self.own.mkdir(parents=True, exist_ok=True)
                lock = stack.enter_context(open(self.own / "lock", "w"))
                if sys.platform == "win32":
                    import msvcrt

                    msvcrt.locking(lock.fileno(), msvcrt.LK_LOCK, 1)
                else:
                    import fcntl

                    fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def enter(self) -> None:
        """Says that a run of this thread is under way."""
        _drop_dead(self._mark.parent)
        self.put(self._mark.relative_to(self.root), "")

    def exit(self) -> None:
        """Undoes enter()."""
        self._mark.unlink(missing_ok=True)

    def is_entered(self) -> bool:
        """True if another run is under way; on another machine it may have been killed."""
        return bool(self._others())

    def is_entered_here(self) -> bool:
        """True if another run of this machine, or container, is under way."""
        return any(_MINE.fullmatch(path.name) for path in self._others())

    def _others(self) -> list[Path]:
        _drop_dead(self._mark.parent)
        return [path for path in self._mark.parent.glob("*") if path != self._mark]

    @property
    def _mark(self) -> Path:
        return self.own / "runs" / _named_for_me("run")

    # ------------------------------------------------------------ files

    @contextlib.contextmanager
    def partial(self, name: str | Path) -> Iterator[Path]:
        """Temporary path of this thread for DIR/name; a file there at the end of the block is
        removed."""
        partial = self.own / "partial"
        path = partial / _named_for_me(Path(name).name)
        with self.explained(name):
            partial.mkdir(parents=True, exist_ok=True)
            try:
                yield path
            finally:
                path.unlink(missing_ok=True)

    def drop_partial(self) -> None:
        """Removes partial files of killed processes of this machine, or container."""
        _drop_dead(self.own / "partial")

    @contextlib.contextmanager
    def file(self, name: str | Path) -> Iterator[Path]:
        """A path to write to, which becomes DIR/name when the block ends without an exception."""
        final = self.root / name
        with self.partial(name) as path:
            yield path
            final.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, final)

    def put(self, name: str | Path, data: bytes | str) -> None:
        """Writes DIR/name."""
        with self.file(name) as path:
            path.write_bytes(data.encode() if isinstance(data, str) else data)

    @contextlib.contextmanager
    def explained(self, name: str | Path) -> Iterator[None]:
        """Errors with a remedy where a disk is full or closed, also of libraries that report it in
        words of their own."""
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
        """Notes that an image is done. The manifest has only the hash of a large overlay."""
        if overlay and '"overlay":{' not in manifest:
            self.put(f"{NAME}/overlays/{name_of(index)}.bin", overlay)
        else:  # that of an image that this one takes the place of
            (self.own / "overlays" / f"{name_of(index)}.bin").unlink(missing_ok=True)
        self.put(f"{NAME}/manifests/{name_of(index)}.json", manifest)
        text = json.dumps(record, separators=(",", ":"), allow_nan=False)
        self.put(self._record(index).relative_to(self.root), text)

    def record(self, index: int) -> dict[str, Any]:
        """Record given to keep(). NotFound."""
        return _json(self._record(index))

    def manifest(self, index: int) -> str:
        """Manifest given to keep(), JSON. NotFound."""
        return _text(self.own / "manifests" / f"{name_of(index)}.json")

    def overlay(self, index: int) -> bytes | None:
        """Overlay given to keep(), where the manifest leaves it out; otherwise None."""
        path = self.own / "overlays" / f"{name_of(index)}.bin"
        return path.read_bytes() if path.exists() else None

    def has_blob(self, digest: bytes) -> bool:
        return self._blob(digest).exists()

    def keep_blob(self, digest: bytes, data: bytes) -> None:
        """Notes bytes by their SHA-256, once."""
        if not self.has_blob(digest):
            self.put(self._blob(digest).relative_to(self.root), data)

    def blob(self, digest: bytes) -> bytes | None:
        """Blob given to keep_blob(); None if there is none."""
        path = self._blob(digest)
        return path.read_bytes() if path.exists() else None

    def keep_decoding(self, digest: bytes, request: bytes) -> None:
        """Keeps the request whose decoding has that SHA-256, once."""
        path = self._decoding(digest)
        if not path.exists():
            self.put(path.relative_to(self.root), request)

    def decoding(self, digest: bytes) -> bytes | None:
        """Decoding given to keep_decoding(); None if there is none."""
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

    def has_files(self) -> bool:
        """True if DIR has any file or folder but this one."""
        return any(path != self.own for path in self.root.iterdir())

    def has_images(self, but: Container[int] = ()) -> bool:
        """True if an image is done whose index is not in `but`."""
        return any(index not in but for index in self._done())

    def forget(self, images: Container[int]) -> None:
        """Removes the records of images. All other files stay: equal runs may be using them."""
        for index in self._done():
            if index in images:
                self._record(index).unlink(missing_ok=True)

    def _done(self) -> Iterator[int]:
        found = (self.own / "records").glob("*.json")
        return (int(path.stem) for path in found if path.stem.isdigit())


def _is_of(error: Exception, numbers: tuple[int, ...]) -> bool:
    """True if an error has one of these errnos, by its number or by its text."""
    number_of_error = getattr(error, "errno", None)
    return number_of_error in numbers or (
        number_of_error is None and any(os.strerror(number) in str(error) for number in numbers)
    )


def _named_for_me(name: str) -> str:
    """A name in a folder that processes share, of this thread alone."""
    end = name.replace("-", "_")  # so that no host passes for another
    return f"{_HERE}-{os.getpid()}-{threading.get_ident()}-{end}"


def _drop_dead(folder: Path) -> None:
    """Removes from such a folder the remains of processes that were killed here."""
    for path in folder.glob("*"):
        mine = _MINE.fullmatch(path.name)
        if mine and not _is_alive(int(mine[1])):
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


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
    """Name of an image's files: "000123"."""
    return f"{index:06d}"


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
    if not isinstance(found, dict):
        raise FailedPrecondition(f"{path}: holds no JSON object: generate() did not write it")
    return found
