"""The command `heliograph`. One module a subcommand, each with add() and run()."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from .._version import __version__
from ..errors import HeliographError, InvalidArgument, NotFound, Unimplemented
from ._daemon import EXIT_FAILED

EXIT_USAGE = 2  # argparse's own
EXIT_INTERRUPTED = 130


def make_parser() -> argparse.ArgumentParser:
    """Parser of all subcommands."""
    from . import (
        dataset,
        export,
        info,
        open_image,
        render,
        rerender,
        serve,
        validate,
        view,
    )

    parser = argparse.ArgumentParser(
        prog="heliograph",
        description="Path-traced pictures and perfect labels from 3D models.",
        epilog="Exit status: 0 done, 1 failed, 2 wrong usage, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"heliograph {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    looking = (render, view, export, dataset, info, serve)
    for module in (*looking, validate, rerender, open_image):
        module.add(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command; its exit status."""
    return run(make_parser().parse_args(argv))


def run(arguments: argparse.Namespace) -> int:
    """Runs arguments.run and prints its errors; returns the exit status."""
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
