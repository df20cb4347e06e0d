"""gRPC's statuses as typed errors. Used wherever the daemon answers."""

from __future__ import annotations

import re
from typing import Any

import grpc

from ..errors import BY_CODE, HeliographError, Internal, Unavailable
from ._proto import types_pb2 as types

_CODES = {code.value[0]: code.name for code in grpc.StatusCode}
_TOO_LONG = re.compile(r"(Received|Sent) message larger than max \((\d+) vs\. (\d+)\)")


def to_error(error: grpc.RpcError) -> HeliographError:
    """The typed error of a failed call, with the fields of its ErrorDetail."""
    detail = types.ErrorDetail()
    trailers = dict(error.trailing_metadata() or ())
    detail.ParseFromString(trailers.get("heliograph-error-bin", b""))
    name = error.code().name
    text = error.details() or name
    if name == "UNAVAILABLE" and "heliograph-error-bin" not in trailers:  # gRPC's own words
        text = f"there is no connection to the daemon, or it was lost in the middle: {text}"
    if name == "CANCELLED" and not error.cancelled():
        name = "UNAVAILABLE"
        text = f"the daemon cut the call off, because it ends or what it sent was not read: {text}"
    too_long = _TOO_LONG.search(text)  # gRPC's own words, before the daemon sees the request
    if too_long:
        detail.field = "message"
        detail.needed, detail.available = int(too_long[2]), int(too_long[3])
        text = (
            f"message: the request has {detail.needed} bytes, the daemon takes {detail.available}; "
            "split it into several (transactions, queries), or raise the daemon's limit "
            "message_bytes"
            if too_long[1] == "Received"
            else f"message: the answer has {detail.needed} bytes, {detail.available} may travel at "
            "once; ask for less (amodal_masks of many instances are large)"
        )
    return _typed(name, text, detail)


def status_error(code: int, text: str, detail: types.ErrorDetail) -> HeliographError:
    """The typed error of a status that travels in a message; `code`: gRPC's number."""
    return _typed(_CODES.get(code, "UNKNOWN"), text, detail)


def _typed(name: str, text: str, detail: types.ErrorDetail) -> HeliographError:
    if name == "UNAVAILABLE":
        return Unavailable(text, field=detail.field, retry_seconds=detail.retry_seconds)
    if name in BY_CODE:
        return BY_CODE[name](text, **detail_fields(detail))
    return Internal(f"{name}: {text}", **detail_fields(detail))


def detail_fields(detail: types.ErrorDetail) -> dict[str, Any]:
    """Keyword arguments of HeliographError."""
    return {
        "field": detail.field,
        "needed": detail.needed,
        "available": detail.available,
        "users": list(detail.users),
        "nearest": list(detail.nearest),
        "expected": detail.expected,
        "retry_seconds": detail.retry_seconds,
    }
