"""heliograph serve: runs the daemon in this process's place."""

from __future__ import annotations

import argparse
import os
from typing import Any

from .._wire.launch import find_program


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "serve",
        help="run a daemon that several clients share",
        description="Becomes heliographd; all arguments are its own (heliograph serve --help).",
        add_help=False,
        prefix_chars="\0",
    )
    parser.add_argument("flags", nargs=argparse.REMAINDER)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    program = find_program()
    os.execv(program, [program, *arguments.flags])
