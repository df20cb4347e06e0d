"""Typed errors. Raised by every module of the client; made from gRPC statuses in status.py."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Sequence
from types import FrameType
from typing import Any


class FileWarning(UserWarning):
    """Warning that something was assumed of a picture's file, or changed in it.
    `warnings.filterwarnings("error", category=hg.FileWarning)` refuses such files."""

    def __init__(self, message: str) -> None:
        super().__init__(message)


def warn_of_file(path: object, texts: Iterable[str]) -> None:
    """Warns where the user's own code called."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and _package_of(frame) in _OWN:
        level, frame = level + 1, frame.f_back
    for text in texts:
        warnings.warn(f"{path}: {text}", FileWarning, stacklevel=level)


def _package_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", "")).split(".")[0]


_OWN = ("heliograph", "nvisii")


class HeliographError(Exception):
    """Base of all errors of the daemon and the client. The message names the remedy.

    field: path of the offending value, e.g. "edits[3].mesh.indices", or "".
    code: the gRPC code's name, e.g. "NOT_FOUND".
    reason: why, e.g. "LIMIT_EXCEEDED"; docs/protocol.md lists them; "": gRPC's or the client's own.
    limit: the name of the limit that was exceeded, or "".
    needed, used, allowed: amount of the limit that the call needs, amount in use, and the limit
    itself, in the unit that the message names.
    retry_seconds: time until the same call may work; 0.0: not known.
    """

    code = "UNKNOWN"

    def __init__(
        self,
        message: str,
        *,
        field: str = "",
        reason: str = "",
        limit: str = "",
        needed: int = 0,
        used: int = 0,
        allowed: int = 0,
        users: Sequence[str] = (),
        nearest: Sequence[str] = (),
        expected: int = 0,
        retry_seconds: float = 0.0,
    ) -> None:
        super().__init__(message)
        self.field = field
        self.reason = reason
        self.limit = limit
        self.needed = needed
        self.used = used
        self.allowed = allowed
        self.users = list(users)
        self.nearest = list(nearest)
        self.expected = expected
        self.retry_seconds = retry_seconds

    @property
    def available(self) -> int:
        """Amount left of the limit, in its unit."""
        return self.allowed - self.used

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class Cancelled(HeliographError):
    """The call was cancelled."""

    code = "CANCELLED"


class InvalidArgument(HeliographError, ValueError):
    """Would never work; `.field` is the path of the offending value."""

    code = "INVALID_ARGUMENT"


class DeadlineExceeded(HeliographError, TimeoutError):
    """The call's timeout passed."""

    code = "DEADLINE_EXCEEDED"


class NotFound(HeliographError, LookupError):
    """Names an object that does not exist; `.nearest` lists the nearest names."""

    code = "NOT_FOUND"


class AlreadyExists(HeliographError):
    """The name is taken."""

    code = "ALREADY_EXISTS"


class PermissionDenied(HeliographError):
    """The daemon does not admit this client."""

    code = "PERMISSION_DENIED"


class Unauthenticated(HeliographError):
    """The token or the session is missing or wrong."""

    code = "UNAUTHENTICATED"


class ResourceExhausted(HeliographError):
    """Over a limit: `.limit` is its name; `.needed` against `.available`, which is `.allowed` less
    `.used`, and `.retry_seconds` when waiting helps."""

    code = "RESOURCE_EXHAUSTED"


class FailedPrecondition(HeliographError):
    """The wrong state now; `.users` lists who still refers to an object."""

    code = "FAILED_PRECONDITION"


class Aborted(HeliographError):
    """Another writer was faster: repeat the transaction. `.expected`: the revision or number that
    the daemon expected."""

    code = "ABORTED"


class OutOfRange(HeliographError):
    """A revision that is no longer kept, or not there yet. `.expected`: the nearest that is."""

    code = "OUT_OF_RANGE"


class Unimplemented(HeliographError, NotImplementedError):
    """Names a feature that this version lacks."""

    code = "UNIMPLEMENTED"


class Internal(HeliographError):
    """A fault of the daemon or the connection."""

    code = "INTERNAL"


class Unavailable(HeliographError, ConnectionError):
    """The daemon cannot be reached.

    When a private daemon died: its exit code (negative: the signal) and its last 20 log lines.
    """

    code = "UNAVAILABLE"

    def __init__(
        self,
        message: str,
        *,
        exit_code: int | None = None,
        log: Sequence[str] = (),
        **fields: Any,
    ) -> None:
        super().__init__(message, **fields)
        self.exit_code = exit_code
        self.log = list(log)


_CLASSES: tuple[type[HeliographError], ...] = (
    Cancelled,
    InvalidArgument,
    DeadlineExceeded,
    NotFound,
    AlreadyExists,
    PermissionDenied,
    Unauthenticated,
    ResourceExhausted,
    FailedPrecondition,
    Aborted,
    OutOfRange,
    Unimplemented,
    Internal,
)
BY_CODE = {kind.code: kind for kind in _CLASSES}
