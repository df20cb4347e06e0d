"""The flags that choose a daemon, and its client. Used by the subcommands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ..errors import InvalidArgument, Unauthenticated, Unavailable

if TYPE_CHECKING:
    from ..client.client import Client

EXIT_FAILED = 1
_Made = TypeVar("_Made")
_TRIES = 3  # with a daemon that is lost each time


def add_connection(parser: argparse.ArgumentParser) -> None:
    """The flags that choose a daemon."""
    group = parser.add_argument_group("daemon")
    group.add_argument(
        "--address", metavar="ADDRESS", help="unix:///path or host:port; default: a private daemon"
    )
    group.add_argument(
        "--token", help="your token; other users of this machine see it; --token-file is better"
    )
    group.add_argument("--token-file", metavar="FILE", help="the file that the token is in")
    group.add_argument("--tls", action="store_true", help="encrypt; implied by the next ones")
    group.add_argument(
        "--tls-ca", metavar="FILE", help="CA that signed the daemon's certificate, PEM"
    )
    group.add_argument("--tls-cert", metavar="FILE", help="your certificate, PEM")
    group.add_argument("--tls-key", metavar="FILE", help="its key, PEM")
    group.add_argument(
        "--tls-server-name",
        metavar="NAME",
        help="the name in the daemon's certificate, where the address has another",
    )
    group.add_argument(
        "--threads", type=int, metavar="N", help="render threads of a private daemon; default all"
    )


def check_source(arguments: argparse.Namespace, command: str) -> None:
    """A file, or a scene of a daemon that is named."""
    if (arguments.model is None) == (arguments.scene is None):
        raise InvalidArgument(f"{command}: give a file, or --scene NAME with --address")
    if arguments.scene is not None and arguments.address is None:
        raise InvalidArgument("--scene: needs the --address of the daemon that has it")


def connect(arguments: argparse.Namespace, flags: Sequence[str] = ()) -> Client:
    """The client those flags name; `flags`: more of a private daemon's."""
    from pathlib import Path

    import heliograph

    given = {
        name: getattr(arguments, f"tls_{name}") for name in ("ca", "cert", "key", "server_name")
    }
    tls = heliograph.TLS(**given) if arguments.tls or any(given.values()) else None
    token = Path(arguments.token_file) if arguments.token_file else arguments.token
    if arguments.threads is not None:
        if arguments.address is not None:
            raise InvalidArgument("--threads: is for a private daemon; leave --address out")
        flags = (*flags, "--threads", str(arguments.threads))
    return heliograph.connect(arguments.address, token=token, tls=tls, arguments=flags)


def with_client(arguments: argparse.Namespace, work: Callable[[Client], _Made]) -> _Made:
    """work(client); once more from its beginning, over another connection, where a daemon that runs
    was lost meanwhile: it may be restarted."""
    client, left = connect(arguments), _TRIES
    while True:
        try:
            with client:
                return work(client)
        except (Unavailable, Unauthenticated):
            left -= 1
            if arguments.address is None or left == 0:
                raise
        client = _connect_again(arguments)


def _connect_again(arguments: argparse.Namespace) -> Client:
    from .._wire.link import Patience

    patience = Patience()
    while True:
        try:
            return connect(arguments)
        except Unavailable:
            if not patience.wait():
                raise
