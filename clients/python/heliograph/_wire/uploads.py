"""Uploads that a transaction names by hash, kept until no repetition can need them. The daemon
frees uploads that no scene, job or recent call refers to; a call that names one is refused with its
hash, and repeated here once that was sent again. Used by edits, renders and assets."""

from __future__ import annotations

import hashlib
import re
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import FailedPrecondition, HeliographError, NotFound

if TYPE_CHECKING:
    from ..client.client import Client
    from ..scene.assets import Decoding

_HASH = re.compile(r"\b[0-9a-f]{64}\b")
_REMEMBERED = 4096  # hashes; a forgotten one is offered to the daemon again
_Key = TypeVar("_Key")
_Value = TypeVar("_Value")
_Answer = TypeVar("_Answer")


class Recent(OrderedDict[_Key, _Value]):
    """The entries set or read last: a client that runs on does not grow."""

    def __setitem__(self, key: _Key, value: _Value) -> None:
        super().__setitem__(key, value)
        self.move_to_end(key)
        while len(self) > _REMEMBERED:
            self.popitem(last=False)

    def __getitem__(self, key: _Key) -> _Value:
        value = super().__getitem__(key)
        self.move_to_end(key)
        return value


class Sources:
    """The bytes, and the decoded files, that one transaction names. owns: arrays are copied, for
    who made them may change them while the transaction is in use."""

    def __init__(self, owns: bool) -> None:
        self._owns = owns
        self._blobs: dict[bytes, memoryview | bytes] = {}
        self._decodings: dict[bytes, Decoding] = {}

    def add(self, digest: bytes, data: memoryview | bytes) -> None:
        """Bytes that were uploaded."""
        if digest not in self._blobs:
            self._blobs[digest] = bytes(data) if self._owns else data

    def add_decoding(self, digest: bytes, decoding: Decoding) -> None:
        """Adds a file's decoding that the daemon made, by its digest."""
        self._decodings[digest] = decoding

    def clear(self) -> None:
        """The transaction is over."""
        self._blobs.clear()
        self._decodings.clear()

    def _send(self, client: Client, digest: bytes) -> bool:
        """Sends the bytes or files of a hash again; True if it is known."""
        if digest in self._blobs:
            data = self._blobs[digest]
            if hashlib.sha256(data).digest() != digest:
                raise FailedPrecondition(
                    "an array of more than 1 MiB was changed before the transaction that names it "
                    "was over, and the daemon needs it again: leave it as it is until then"
                )
            client.store.send_again(digest, data)
            return True
        if digest in self._decodings:
            self._decodings[digest].send_again(client, digest)
            return True
        return False

    def bring(self, client: Client, error: HeliographError) -> bool:
        """Sends the uploads that a refusal names again; True if it names any of these."""
        return any([self._send(client, digest) for digest in missing(error)])

    def complete(self, client: Client, call: Callable[[], _Answer]) -> _Answer:
        """The call's answer; each upload that it is refused for is sent again once."""
        return repeated(call, lambda digest: self._send(client, digest))


def repeated(call: Callable[[], _Answer], send: Callable[[bytes], bool]) -> _Answer:
    """The call's answer, repeated while it is refused for hashes that send() knows."""
    tried: set[bytes] = set()
    while True:
        try:
            return call()
        except (NotFound, FailedPrecondition) as error:
            named = missing(error) - tried
            tried |= named
            if not any([send(digest) for digest in named]):
                raise


def missing(error: HeliographError) -> set[bytes]:
    """The hashes that a refusal names."""
    found: Iterable[Any] = _HASH.findall(f"{error.field} {error}".lower())
    return {bytes.fromhex(digest) for digest in found}
