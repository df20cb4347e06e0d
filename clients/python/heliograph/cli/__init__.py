"""The command `heliograph`. One module a subcommand, each with add() and run()."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from .. import __version__
from ..errors import HeliographError, InvalidArgument, NotFound, Unimplemented

EXIT_FAILED = 1
EXIT_USAGE = 2  # argparse's own
EXIT_INTERRUPTED = 130


def make_parser() -> argparse.ArgumentParser:
    """All subcommands."""
    from . import dataset, info, open_image, render, replay, rerender, serve, validate, view

    parser = argparse.ArgumentParser(
        prog="heliograph",
        description="Path-traced pictures and perfect labels from 3D models.",
        epilog="Exit status: 0 done, 1 failed, 2 wrong usage, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"heliograph {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (render, view, dataset, info, serve, validate, rerender, open_image, replay):
        module.add(commands)
    return parser


def add_connection(parser: argparse.ArgumentParser) -> None:
    """The flags that say which daemon."""
    group = parser.add_argument_group("daemon")
    group.add_argument(
        "--address", metavar="ADDRESS", help="unix:///path or host:port; default: a private daemon"
    )
    group.add_argument(
        "--token", help="who you are; other users of this machine see it; --token-file is better"
    )
    group.add_argument("--token-file", metavar="FILE", help="the file that the token is in")
    group.add_argument("--tls", action="store_true", help="encrypt; implied by the next ones")
    group.add_argument("--tls-ca", metavar="FILE", help="who signed the daemon's certificate, PEM")
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


def connect(arguments: argparse.Namespace, flags: Sequence[str] = ()) -> object:
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


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command; its exit status."""
    arguments = make_parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except HeliographError as error:
        print(f"heliograph: {error}", file=sys.stderr)
        usage = (InvalidArgument, NotFound, Unimplemented)
        return EXIT_USAGE if isinstance(error, usage) else EXIT_FAILED
    except BrokenPipeError:  # who read the output has seen enough, as head does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except FileNotFoundError as error:
        print(f"heliograph: {error.filename}: {error.strerror}", file=sys.stderr)
        return EXIT_USAGE
    except OSError as error:
        print(f"heliograph: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
