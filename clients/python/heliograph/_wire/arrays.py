"""numpy to wire and back: checked arrays, inline or uploaded. Used by edits, queries and reads."""

from __future__ import annotations

import contextlib
import hashlib
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidArgument
from ._proto import render_pb2 as render
from ._proto import service_pb2 as service
from ._proto import types_pb2 as types
from .connection import Connection
from .lent import GpuArray, Loan, Loans, wrong_shape
from .uploads import Recent, Sources

if TYPE_CHECKING:
    from ..scene.assets import Decoding

INLINE_BYTES = 1 << 20
SHARED_BYTES = 1 << 16  # from here on shared memory is faster than the message
CHUNK_BYTES = 1 << 20
MESSAGE_BYTES = 8 << 20  # half of a daemon's default limit
NdArray = np.ndarray[Any, np.dtype[Any]]

_DTYPES: dict[int, str] = {
    types.D_TYPE_U8: "u1",
    types.D_TYPE_U16: "<u2",
    types.D_TYPE_U32: "<u4",
    types.D_TYPE_I32: "<i4",
    types.D_TYPE_U64: "<u8",
    types.D_TYPE_F16: "<f2",
    types.D_TYPE_F32: "<f4",
    types.D_TYPE_F64: "<f8",
}
_WIRE: dict[Any, Any] = {np.dtype(name): number for number, name in _DTYPES.items()}


def dtype_of(number: int) -> np.dtype[Any]:
    """The numpy dtype of a DType."""
    return np.dtype(_DTYPES[number])


def checked(
    value: Any, field: str, dtype: str, shape: tuple[int | None, ...], finite: bool = True
) -> NdArray:
    """`value` as a contiguous array of that dtype and shape (None: any length).

    Converts once; refuses wrong shapes, non-finite numbers, and integers that do not fit.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "biuf":
            raise TypeError(f"holds {given.dtype}")
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"{field}: not an array of numbers ({error})", field=field) from None
    if given.shape != shape and (
        len(given.shape) != len(shape)
        or any(want is not None and want != got for want, got in zip(shape, given.shape))
    ):
        raise wrong_shape(field, shape, given.shape)
    wanted = np.dtype(dtype)
    if wanted.kind in "iu" and given.dtype != wanted:
        _check_integers(given, field, wanted)
    out = np.asarray(given, dtype=wanted, order="C")
    if finite and wanted.kind == "f" and not np.isfinite(out).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(out))[0])
        path = field + "".join(f"[{i}]" for i in where)
        raise InvalidArgument(f"{path} is {out[where]}: every number must be finite", field=path)
    return out


def _check_integers(given: NdArray, field: str, wanted: np.dtype[Any]) -> None:
    if given.size == 0:
        return
    limits = np.iinfo(wanted)
    if given.dtype.kind == "f" and not (np.isfinite(given).all() and (given % 1 == 0).all()):
        raise InvalidArgument(f"{field}: needs whole numbers", field=field)
    low, high = given.min(), given.max()
    if low < limits.min or high > limits.max:
        raise InvalidArgument(
            f"{field}: holds {low if low < limits.min else high}, outside "
            f"[{limits.min}, {limits.max}]",
            field=field,
        )


def bytes_of(data: NdArray) -> memoryview:
    """The bytes of a contiguous array, shared with it."""
    flat: Any = data.reshape(-1).view(np.uint8)
    return memoryview(flat)


def describe(data: NdArray) -> types.Array:
    """The Array message of `data` without its bytes."""
    return types.Array(dtype=_WIRE[data.dtype], shape=data.shape)


def inline(data: NdArray) -> types.Array:
    """The Array message that carries `data` itself."""
    message = describe(data)
    message.inline = data.tobytes()
    return message


def from_message(message: types.Array) -> NdArray:
    """A read-only view of an Array's inline bytes."""
    flat = np.frombuffer(message.inline, dtype=dtype_of(message.dtype))
    return flat.reshape(tuple(message.shape))


def filled(array: NdArray | None, part: service.ReadReply) -> NdArray:
    """The array of a reply, which may come in several parts; None: this is the first."""
    if array is None:
        array = np.empty(tuple(part.array.shape), dtype=dtype_of(part.array.dtype))
    data = np.frombuffer(part.array.inline, dtype=np.uint8)
    array.reshape(-1).view(np.uint8)[part.offset : part.offset + data.size] = data
    return array


class Store:
    """Uploads of one client: inline up to 1 MiB, then by hash; changing arrays by shared memory
    from 64 KiB on, or anonymously.

    Remembers hashes that the session has, so that the same bytes travel once, and no bytes.
    decodings: of files by the daemon, by hash. Thread: any.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._known: Recent[bytes, None] = Recent()
        self.decodings: Recent[bytes, Decoding] = Recent()
        self._witness: Callable[[bytes, memoryview | bytes], Any] | None = None
        self._loans = Loans(connection)
        self._link: Any = None

    def asset(self, data: NdArray, sources: Sources) -> types.Array:
        """An array that stays as it is (topology, texels): by SHA-256 when it is large, and then
        among the sources."""
        if data.nbytes <= INLINE_BYTES:
            return inline(data)
        message = describe(data)
        message.blob = self.blob(bytes_of(data))
        sources.add(message.blob, bytes_of(data))
        return message

    def edited(self, data: NdArray) -> types.Array:
        """An array that changes often (vertices, matrices): not hashed, used up by one edit."""
        shared = self._connection.link.shared if data.nbytes >= SHARED_BYTES else None
        if shared is None and data.nbytes <= INLINE_BYTES:
            return inline(data)
        message = describe(data)
        if shared is not None:
            message.buffer.CopyFrom(shared.hand_over(bytes_of(data)))
            return message
        message.upload = uuid.uuid4().hex
        request = service.UploadBlobRequest(request_id=message.upload)
        self._push(bytes_of(data), request)
        return message

    def lent(self, data: GpuArray) -> tuple[types.Array, Loan]:
        """An array on a GPU, which stays there; the message names it while the loan lives."""
        place, loan = self._loans.put(data)
        return types.Array(dtype=_WIRE[data.dtype], shape=data.shape, buffer=place), loan

    def blob(self, data: memoryview | bytes, digest: bytes = b"") -> bytes:
        """Uploads bytes unless the session has them; their SHA-256, which may be known."""
        digest = digest or hashlib.sha256(data).digest()
        if self._witness is not None:
            self._witness(digest, data)
        link = self._connection.link
        with self._lock:
            if link is not self._link:  # another session, or a daemon that was restarted
                self._link = link
                self._known.clear()
            if digest in self._known:
                self._known.move_to_end(digest)
                return digest
        self.send_again(digest, data)
        with self._lock:
            self._known[digest] = None
        return digest

    def send_again(self, digest: bytes, data: memoryview | bytes) -> None:
        """Uploads bytes by their SHA-256, even if the session had them."""
        request = service.UploadBlobRequest(request_id=uuid.uuid4().hex, sha256=digest)
        self._push(memoryview(data), request)

    @contextlib.contextmanager
    def witnessed(self, witness: Callable[[bytes, memoryview | bytes], Any]) -> Iterator[None]:
        """Within the block, calls witness(SHA-256, data) for each blob that an edit needs."""
        self._witness = witness
        try:
            yield
        finally:
            self._witness = None

    def lighten(self, message: Any, sources: Sources) -> None:
        """Uploads the larger ones of the arrays that a message carries itself, by hash."""
        for field, value in message.ListFields():
            if field.message_type is None:
                continue
            repeated = hasattr(value, "__len__")
            for part in value if repeated else (value,):
                if not isinstance(part, types.Array):
                    if hasattr(part, "ListFields"):
                        self.lighten(part, sources)
                elif len(part.inline) >= SHARED_BYTES:
                    data = part.inline
                    part.blob = self.blob(data)
                    sources.add(part.blob, data)

    def forget_parent(self) -> None:
        """Replaces the lock and the loans after a fork, in the child."""
        self._lock = threading.Lock()
        self._loans = Loans(self._connection)
        self._witness = None

    def _push(self, data: memoryview, first: service.UploadBlobRequest) -> None:
        first.size = data.nbytes
        self._connection.push("UploadBlob", _chunks(data, first))


def _chunks(
    data: memoryview, first: service.UploadBlobRequest
) -> Iterator[service.UploadBlobRequest]:
    request = first
    for start in range(0, max(1, data.nbytes), CHUNK_BYTES):
        request.chunk = bytes(data[start : start + CHUNK_BYTES])
        yield request
        request = service.UploadBlobRequest()


class Columns(Mapping[str, Any]):
    """Named numpy columns, one row per instance, ray or sample; read-only.

    `columns["t"]` and `columns.t` are the same; text columns are lists of str.
    """

    def __init__(self, columns: dict[str, Any], remedy: str = "") -> None:
        self._columns = columns
        self._remedy = remedy

    @classmethod
    def of(cls, messages: Any, remedy: str = "") -> Columns:
        """Columns of LabelColumn messages. remedy: how to get a column that is missing."""
        return cls({message.name: _column(message) for message in messages}, remedy)

    def __getitem__(self, name: str) -> Any:
        try:
            return self._columns[name]
        except KeyError:
            have = ", ".join(self._columns) or "none"
            raise KeyError(f"no column {name!r} (there are: {have}){self._remedy}") from None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._columns]

    def __repr__(self) -> str:
        return f"Columns({', '.join(self._columns)})"

    def __getstate__(self) -> dict[str, Any]:
        return {"_columns": self._columns, "_remedy": self._remedy}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def _column(message: render.LabelColumn) -> Any:
    if message.strings or not message.shape:
        return list(message.strings)
    return np.frombuffer(message.data, dtype=dtype_of(message.dtype)).reshape(tuple(message.shape))
