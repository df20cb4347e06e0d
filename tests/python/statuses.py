"""google.rpc.Status as a daemon fills one."""

import grpc
from google.rpc import error_details_pb2 as details
from google.rpc import status_pb2


def status(code: grpc.StatusCode, text: str, **fields) -> status_pb2.Status:
    """fields: field, users, nearest, expected, retry_seconds, and metadata of ErrorInfo."""
    out = status_pb2.Status(code=code.value[0], message=text)
    field, users = fields.pop("field", ""), fields.pop("users", ())
    retry, nearest = fields.pop("retry_seconds", 0), fields.pop("nearest", ())
    info = details.ErrorInfo(reason=fields.pop("reason", "INVALID_VALUE"), domain="heliograph")
    for name, value in fields.items():
        info.metadata[name] = str(value)
    for i, name in enumerate(nearest):
        info.metadata[f"nearest_{i}"] = name
    kinds = [info]
    if field:
        kinds.append(details.BadRequest(field_violations=[{"field": field}]))
    if retry:
        kinds.append(details.RetryInfo())
        kinds[-1].retry_delay.FromMilliseconds(int(1000 * retry))
    if users:
        named = [{"type": "IN_USE", "subject": user} for user in users]
        kinds.append(details.PreconditionFailure(violations=named))
    for kind in kinds:
        out.details.add().Pack(kind)
    return out
