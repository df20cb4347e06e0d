"""Address of a daemon, trust in it (TLS), and this client's credentials. Used by link.py."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Optional, Union
from urllib.parse import quote

import grpc

from ..errors import InvalidArgument

_OPTIONS = (
    # Replies of a stream come straight to who waits for them: a frame is a quarter of a millisecond
    # sooner than through a thread.
    ("SingleThreadedUnaryStream", 1),  # of grpc.experimental.ChannelOptions
    ("grpc.max_receive_message_length", -1),
    ("grpc.max_send_message_length", -1),
    ("grpc.use_local_subchannel_pool", 1),  # a forked child must not meet its parent's connection
    ("grpc.enable_http_proxy", 0),
    ("grpc.initial_reconnect_backoff_ms", 50),
    ("grpc.min_reconnect_backoff_ms", 5000),  # how long one attempt may take
    ("grpc.max_reconnect_backoff_ms", 250),
)
Token = Union[str, "os.PathLike[str]", None]
File = Union[str, "os.PathLike[str]", None]
Headers = tuple[tuple[str, str], ...]
Trace = Callable[[], Optional[Mapping[str, str]]]
_OF_TRACES = ("traceparent", "tracestate")


@dataclasses.dataclass(frozen=True)
class TLS:
    """Encryption and certificates; files in PEM, read when a connection is made.

    ca: who signed the daemon's certificate; None: whom the system trusts.
    cert, key: this client's own, for a daemon that demands one (mutual TLS).
    server_name: the name in the daemon's certificate, where the address has another (a tunnel).
    """

    ca: File = None
    cert: File = None
    key: File = None
    server_name: str | None = None

    def __post_init__(self) -> None:
        if (self.cert is None) != (self.key is None):
            raise InvalidArgument("tls: cert and key go together", field="tls")

    def credentials(self) -> grpc.ChannelCredentials:
        """Credentials of a gRPC channel. Reads the files of ca, key and cert."""
        return grpc.ssl_channel_credentials(_read(self.ca), _read(self.key), _read(self.cert))


@dataclasses.dataclass(frozen=True)
class Access:
    """Address of a daemon, and the credentials that it asks for.

    token: itself, or (a path) the file that it is in, read again for each call, so that it may be
    replaced while the client runs.
    trace: returns, in each call's thread, the headers of the trace that it is part of. It is not
    pickled.
    """

    address: str
    token: Token = dataclasses.field(default=None, repr=False)
    tls: TLS | None = None
    trace: Trace | None = dataclasses.field(default=None, repr=False, compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return Access, (self.address, self.token, self.tls)

    @property
    def socket(self) -> str:
        """Path of the Unix socket, or ""."""
        return target_of(self.address)[1]

    def channel(self) -> grpc.Channel:
        """A new one."""
        target = target_of(self.address)[0]
        if self.tls is None:
            return grpc.insecure_channel(target, options=_OPTIONS)
        name = self.tls.server_name
        options = (*_OPTIONS, ("grpc.ssl_target_name_override", name)) if name else _OPTIONS
        return grpc.secure_channel(target, self.tls.credentials(), options=options)

    def bearer(self) -> str:
        """The token as it is now; "": there is none."""
        if isinstance(self.token, os.PathLike):
            return Path(self.token).read_text(encoding="utf-8").strip()
        return self.token or ""

    def traced(self) -> Headers:
        """Headers of the caller's trace at this moment; () without a trace."""
        headers_of_trace = self.trace() if self.trace is not None else None
        headers = ((name.lower(), value) for name, value in (headers_of_trace or {}).items())
        return tuple(header for header in headers if header[0] in _OF_TRACES)

    def metadata(self) -> Headers:
        """Headers of each call: the bearer token and the trace."""
        token = self.bearer()
        return (*((("authorization", f"Bearer {token}"),) if token else ()), *self.traced())


def target_of(address: str) -> tuple[str, str]:
    """(gRPC target, path of the Unix socket or "") of an address. InvalidArgument for anything
    else."""
    if address.startswith("unix:"):
        path = address[len("unix:") :]
        path = path[2:] if path.startswith("//") else path
        if not path.startswith("/"):
            raise InvalidArgument(f"address {address!r}: write unix:///path", field="address")
        return "unix://" + quote(os.fsencode(path)), path  # a URI
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdigit()):
        raise InvalidArgument(
            f'address {address!r}: write "unix:///path" or "host:port"', field="address"
        )
    return address, ""


def _read(path: File) -> bytes | None:
    return None if path is None else Path(path).read_bytes()
