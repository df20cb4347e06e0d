"""Uploads that overlays name by hash: kept with a data set, and brought to the daemon that renders
an image again. Used by generate() and KeptImage."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.uploads import repeated
from ..errors import FailedPrecondition, NotFound
from ..scene import assets
from .folder import Folder

if TYPE_CHECKING:
    from .._wire.arrays import Store
    from ..client.client import Client

_Answer = TypeVar("_Answer")


class Uploads:
    """Bytes that one draw uploads, held until its overlay is accepted: a rejected draw leaves
    nothing. Thread: one at a time."""

    def __init__(self, is_kept: Callable[[bytes], bool]) -> None:
        self._is_kept = is_kept
        self._blobs: dict[bytes, bytes] = {}

    def note(self, digest: bytes, data: memoryview | bytes) -> None:
        """A witness of Store: bytes that are not kept yet are copied."""
        if digest not in self._blobs and not self._is_kept(digest):
            self._blobs[digest] = bytes(data)

    def keep(self, folder: Folder, names: Iterable[bytes], store: Store) -> None:
        """Keeps the blobs that an overlay names, and the files that the daemon decoded for it."""
        for digest in names:
            if digest in self._blobs:
                folder.keep_blob(digest, self._blobs[digest])
            elif digest in store.decodings:
                self._keep_files(folder, store.decodings[digest])
                request = store.decodings[digest].request
                folder.keep_decoding(digest, request.SerializeToString(deterministic=True))

    def _keep_files(self, folder: Folder, decoding: assets.Decoding) -> None:
        for file in decoding.request.files:
            if not file.sha256 or folder.has_blob(file.sha256):
                continue
            data = self._blobs.get(file.sha256) or _unchanged(decoding.paths[file.path], file)
            folder.keep_blob(file.sha256, data)


def _unchanged(path: Path, file: service.BundleFile) -> bytes:
    """The bytes of a file that was decoded before this draw."""
    data = path.read_bytes() if path.is_file() else b""
    if hashlib.sha256(data).digest() != file.sha256:
        raise FailedPrecondition(
            f"{path} is not what it was when it was decoded, so that the image cannot be rendered "
            "again: leave files that the randomizer uses as they are until generate() returns"
        )
    return data


class Kept:
    """Uploads that a data set keeps of its overlays, for a daemon that renders images again."""

    def __init__(self, folder: Folder, client: Client) -> None:
        self._folder, self._client = folder, client

    def bring(self, overlay: pb.Transaction) -> None:
        """Gives the daemon the uploads that an overlay names, as far as they are kept."""
        for digest in named(overlay):
            self._send(digest, self._client.store.blob)

    def complete(self, call: Callable[[], _Answer]) -> _Answer:
        """The call's answer; each upload that it is refused for is sent again once."""
        return repeated(call, self._send_again)

    def _send_again(self, digest: bytes) -> bool:
        return self._send(digest, lambda data, name: self._client.store.send_again(name, data))

    def _send(self, digest: bytes, send: Callable[[bytes, bytes], Any]) -> bool:
        """Sends the bytes or files of a hash; True if they are kept."""
        data, decoding = self._folder.blob(digest), self._folder.decoding(digest)
        if data is not None:
            send(data, digest)
        elif decoding is not None:
            request = service.DecodeAssetRequest.FromString(decoding)
            for file in filter(lambda file: file.sha256, request.files):
                send(_kept(self._folder, file), file.sha256)
            self.complete(lambda: assets.decode_again(self._client, digest, request))
        return data is not None or decoding is not None


def _kept(folder: Folder, file: service.BundleFile) -> bytes:
    data = folder.blob(file.sha256)
    if data is None:
        raise NotFound(
            f"{folder.own / 'blobs' / file.sha256.hex()} is not there, which was {file.path}: the "
            "data set was not copied whole"
        )
    return data


def named(message: Any) -> Iterator[bytes]:
    """The hashes in a message: of blobs, and of assets that it places."""
    if isinstance(message, types.Array) and message.blob:
        yield message.blob
    if isinstance(message, pb.Instantiate):
        yield message.asset
    for field, value in message.ListFields():
        if field.message_type is None:
            continue
        for part in value if hasattr(value, "__len__") else (value,):
            if hasattr(part, "ListFields"):
                yield from named(part)
