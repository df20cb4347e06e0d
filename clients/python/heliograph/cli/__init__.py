"""The command `heliograph`. One module a subcommand, each with add() and run()."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from .. import __version__
from ..errors import HeliographError, InvalidArgument, NotFound, Unimplemented

EXIT_FAILED = 1
EXIT_USAGE = 2  # argparse's own
EXIT_INTERRUPTED = 130


def make_parser() -> argparse.ArgumentParser:
    """All subcommands."""
    from . import info, render, rerender, serve

    parser = argparse.ArgumentParser(
        prog="heliograph",
        description="Path-traced pictures and perfect labels from 3D models.",
        epilog="Exit status: 0 done, 1 failed, 2 wrong usage, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"heliograph {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (render, info, serve, rerender):
        module.add(commands)
    return parser


def add_connection(parser: argparse.ArgumentParser) -> None:
    """The flags that say which daemon."""
    group = parser.add_argument_group("daemon")
    group.add_argument(
        "--address", metavar="ADDRESS", help="unix:///path or host:port; default: a private daemon"
    )
    group.add_argument("--token", help="token of a daemon reached over TCP")
    group.add_argument(
        "--threads", type=int, metavar="N", help="render threads of a private daemon; default all"
    )


def connect(arguments: argparse.Namespace) -> object:
    """The client those flags name."""
    import heliograph

    flags: Sequence[str] = ()
    if arguments.threads is not None:
        flags = ("--threads", str(arguments.threads))
    return heliograph.connect(arguments.address, token=arguments.token, arguments=flags)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command; its exit status."""
    arguments = make_parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except HeliographError as error:
        print(f"heliograph: {error}", file=sys.stderr)
        usage = (InvalidArgument, NotFound, Unimplemented)
        return EXIT_USAGE if isinstance(error, usage) else EXIT_FAILED
    except OSError as error:
        print(f"heliograph: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
