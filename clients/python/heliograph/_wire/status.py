"""gRPC's statuses as typed errors. Used wherever the daemon answers."""

from __future__ import annotations

import itertools
import re
from typing import Any

import grpc
from google.rpc import error_details_pb2 as details_pb
from google.rpc import status_pb2

from ..errors import BY_CODE, HeliographError, Internal, Unavailable

_CODES = {code.value[0]: code.name for code in grpc.StatusCode}
_TOO_LONG = re.compile(r"(Received|Sent) message larger than max \((\d+) vs\. (\d+)\)")
_DETAILS = "grpc-status-details-bin"


def to_error(error: grpc.RpcError) -> HeliographError:
    """The typed error of a failed call."""
    trailers = dict(error.trailing_metadata() or ())
    status = status_pb2.Status.FromString(trailers.get(_DETAILS, b""))
    name = error.code().name
    text = error.details() or name
    if name == "UNAVAILABLE" and _DETAILS not in trailers:  # gRPC's own words
        text = f"there is no connection to the daemon, or it was lost in the middle: {text}"
    if name == "CANCELLED" and not error.cancelled():
        name = "UNAVAILABLE"
        text = f"the daemon cut the call off, because it ends, or its replies were not read: {text}"
    fields = fields_of(status)
    too_long = _TOO_LONG.search(text)  # gRPC's own words, before the daemon sees the request
    if too_long:
        needed, allowed = int(too_long[2]), int(too_long[3])
        fields.update(field="message", needed=needed, allowed=allowed)
        text = (
            f"message: the request has {needed} bytes, the daemon takes {allowed}; "
            "split it into several (transactions, queries), or raise the daemon's limit "
            "message_bytes"
            if too_long[1] == "Received"
            else f"message: the answer has {needed} bytes, {allowed} may travel at "
            "once; ask for less (amodal_masks of many instances are large)"
        )
    return _typed(name, text, fields)


def status_error(status: status_pb2.Status) -> HeliographError:
    """The typed error of a status that travels in a message."""
    name = _CODES.get(status.code, "UNKNOWN")
    return _typed(name, status.message, fields_of(status))


def _typed(name: str, text: str, fields: dict[str, Any]) -> HeliographError:
    if name == "UNAVAILABLE":
        return Unavailable(text, **fields)
    if name in BY_CODE:
        return BY_CODE[name](text, **fields)
    return Internal(f"{name}: {text}", **fields)


def fields_of(status: status_pb2.Status) -> dict[str, Any]:
    """Keyword arguments of HeliographError, of the details that proto/heliograph/v1/errors.proto
    describes."""
    out: dict[str, Any] = {}
    info, bad = details_pb.ErrorInfo(), details_pb.BadRequest()
    retry, failure = details_pb.RetryInfo(), details_pb.PreconditionFailure()
    for detail in status.details:
        if detail.Unpack(info):
            out.update(_of_info(info))
        elif detail.Unpack(bad) and bad.field_violations:
            out["field"] = bad.field_violations[0].field
        elif detail.Unpack(retry):
            out["retry_seconds"] = retry.retry_delay.ToTimedelta().total_seconds()
        elif detail.Unpack(failure):
            out["users"] = [each.subject for each in failure.violations if each.type == "IN_USE"]
    return out


def _of_info(info: details_pb.ErrorInfo) -> dict[str, Any]:
    metadata = info.metadata
    names = (f"nearest_{i}" for i in itertools.count())
    return {
        "reason": info.reason,
        "limit": metadata.get("limit", ""),
        "nearest": [metadata[name] for name in itertools.takewhile(metadata.__contains__, names)],
        **{name: int(metadata.get(name, 0)) for name in ("needed", "used", "allowed", "expected")},
    }
