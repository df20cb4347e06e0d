"""Arrays on a GPU on their way to a scene: copied there into buffers that the daemon lent, so that
this process's host never has them. Used by pose.py, arrays.py and edit.py."""

from __future__ import annotations

import math
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..errors import FailedPrecondition, InvalidArgument, Unimplemented
from . import cuda
from ._proto import service_pb2 as service
from ._proto import types_pb2 as types
from .connection import Connection
from .tensors import is_tensor

_KEPT = 4  # rooms that wait for the next array; more go back to the daemon


def is_on_gpu(value: Any) -> bool:
    """True for an array in a GPU's memory: a tensor of PyTorch, an array of CuPy or JAX."""
    return not isinstance(value, np.ndarray) and hasattr(value, "__cuda_array_interface__")


def wrong_shape(field: str, want: Sequence[int | None], has: Sequence[int]) -> InvalidArgument:
    """The refusal of an array; None in `want`: any length."""
    text = ", ".join("N" if n is None else str(n) for n in want)
    fixed, size = math.prod(n for n in want if n is not None), math.prod(has)
    fits = size % fixed == 0 if None in want else size == fixed
    remedy = "; reshape it" if fits else ""
    return InvalidArgument(f"{field}: needs shape ({text}), has {has}{remedy}", field=field)


class GpuArray:
    """Array in a GPU's memory, checked: shape, dtype, nbytes, address. Keeps the array alive."""

    def __init__(
        self, value: Any, field: str, dtypes: Sequence[str], shape: Sequence[int | None]
    ) -> None:
        interface = value.__cuda_array_interface__
        self.shape: tuple[int, ...] = tuple(interface["shape"])
        self.dtype = np.dtype(interface["typestr"])
        self.nbytes = math.prod(self.shape) * self.dtype.itemsize
        self.pointer = int(interface["data"][0])
        self.stream = _stream_of(value, interface)
        self._value = value
        if len(self.shape) != len(shape) or any(
            want is not None and want != got for want, got in zip(shape, self.shape)
        ):
            raise wrong_shape(field, shape, self.shape)
        if self.dtype.str not in dtypes:
            raise InvalidArgument(
                f"{field}: holds {self.dtype}; on a GPU it needs "
                + " or ".join(np.dtype(name).name for name in dtypes),
                field=field,
            )
        if interface.get("strides") is not None and tuple(interface["strides"]) != _packed(self):
            raise InvalidArgument(f"{field}: is not packed; make it contiguous", field=field)
        if self.nbytes == 0:
            raise InvalidArgument(f"{field}: is empty; send it from the host", field=field)

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Any]:
        raise Unimplemented(
            "poses of entities that the same transaction makes come from the host: publish the "
            "entities first, or copy the array there"
        )


def _packed(array: GpuArray) -> tuple[int, ...]:
    """The strides of a contiguous array, bytes."""
    size = array.dtype.itemsize
    return tuple(size * math.prod(array.shape[i + 1 :]) for i in range(len(array.shape)))


def _stream_of(value: Any, interface: dict[str, Any]) -> int | None:
    """The stream in whose order it is written; None: not known."""
    if is_tensor(value):
        return int(sys.modules["torch"].cuda.current_stream(value.device).cuda_stream)
    stream = interface.get("stream")
    return None if stream is None else int(stream)


class Room:
    """A buffer that the daemon lent, and where it lies here."""

    def __init__(self, place: types.BufferRef, mapping: cuda.Mapping) -> None:
        self.place = place
        self.mapping = mapping


class Loan:
    """Loan of a room to one array; ends when nothing refers to it."""

    def __init__(self, room: Room, back: deque[Room]) -> None:
        self._room = room
        self._back = back

    def __del__(self) -> None:
        self._back.append(self._room)


class Loans:
    """The rooms of one client. Thread: any."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._back: deque[Room] = deque()
        self._link: Any = None

    def put(self, array: GpuArray) -> tuple[types.BufferRef, Loan]:
        """Copies an array on its GPU and waits for that. Returns its name for the daemon, valid
        while the loan lives."""
        room = self._room(array.nbytes)
        loan = Loan(room, self._back)
        room.mapping.device.copy(room.mapping.address, array.pointer, array.nbytes, array.stream)
        place = types.BufferRef()
        place.CopyFrom(room.place)
        place.size = array.nbytes
        return place, loan

    def _room(self, nbytes: int) -> Room:
        link = self._connection.link
        if link.shared is None:
            raise FailedPrecondition(
                "an array on a GPU goes to a daemon on the same machine, over its Unix socket; "
                "copy it to the host first"
            )
        with self._lock:
            if link is not self._link:  # another session, which was lent nothing yet
                self._link = link
                self._back = deque()
            for _ in range(len(self._back)):
                room = self._back.popleft()
                if nbytes <= room.mapping.nbytes <= max(4 * nbytes, 1 << 22):
                    return room
                if len(self._back) < _KEPT:
                    self._back.append(room)
                else:
                    link.shared.give_back(room.place)
        cuda.driver()
        request = service.LendBufferRequest(size=nbytes)
        place = self._connection.call("LendBuffer", request)
        return Room(place, link.shared.mapping(place.buffer))
