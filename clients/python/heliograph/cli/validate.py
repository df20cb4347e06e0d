"""heliograph validate: checks a data set."""

from __future__ import annotations

import argparse
import json
import os
from typing import Any


def add(commands: Any) -> None:
    from ..datasets.validation import FORMATS

    parser = commands.add_parser(
        "validate",
        help="check a data set against its format",
        description="Checks every file of a data set against its format's rules and the arithmetic "
        "between its labels; or a frame that was saved as .exr or .npz. Exit status: 0 clean, "
        "1 faults, 2 wrong usage.",
    )
    parser.add_argument("directory", metavar="DIR")
    parser.add_argument(
        "--format", choices=sorted(FORMATS), help="default: every one whose files are there"
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument(
        "--limit", type=int, default=20, metavar="N", help="faults listed of a check; default 20"
    )
    parser.add_argument(
        "--processes",
        type=int,
        default=os.cpu_count(),
        metavar="N",
        help="default: as many as processors; 0: threads of this process",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    from ..datasets.validation import validate

    report = validate(
        arguments.directory,
        arguments.format,
        limit=arguments.limit,
        processes=arguments.processes,
    )
    print(json.dumps(report.to_json(), indent=1) if arguments.json else report)
    return 0 if report.ok else 1
