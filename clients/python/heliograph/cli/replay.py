"""heliograph replay: plays what a daemon recorded, and tells whether the answers are the same."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from typing import Any

from ._daemon import EXIT_FAILED, add_connection, connect

_PLENTY = ("--limit", "connections=4096", "--limit", "connections_per_peer=4096")


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "replay",
        help="play what `heliographd --record` wrote, and compare the answers",
        description="Plays a recording against a private daemon, or the one at --address, and "
        "tells of each call whether its answer is the same: revisions, ids, statuses, and every "
        "pixel. The same program on the same CPU gives the same. Exit status 1: something differs.",
    )
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--each", action="store_true", help="a line for every call")
    parser.add_argument("--tenant", metavar="NAME", help="whose calls, of a daemon of several")
    parser.add_argument(
        "--asset-root", metavar="DIR", help="of a private daemon, where the recorded one had one"
    )
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    from ..recording import replay
    from ..recording.reader import Recording

    recording = Recording(arguments.file)
    counts: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(prefix="heliograph-") as folder:
        client: Any = connect(arguments, _flags(recording, arguments, folder))
        with client:
            for outcome in replay.replay(recording, client, arguments.tenant):
                counts[outcome.call.method, outcome.verdict] += 1
                if outcome.verdict == replay.DIFFERS or arguments.each:
                    print(f"{outcome.what}: {outcome.verdict}" + _because(outcome.text))
    _print_summary(recording, counts)
    return EXIT_FAILED if any(verdict == replay.DIFFERS for _, verdict in counts) else 0


def _flags(recording: Any, arguments: argparse.Namespace, folder: str) -> list[str]:
    """Of a private daemon like the one that recorded."""
    if arguments.address is not None:
        return []
    flags = [f"--limit={name}={value}" for name, value in recording.header.limits.items()]
    flags += [*_PLENTY, "--state-dir", f"{folder}/state"]
    return flags + (["--asset-root", arguments.asset_root] if arguments.asset_root else [])


def _because(text: str) -> str:
    return f": {text}" if text else ""


def _print_summary(recording: Any, counts: Counter[tuple[str, str]]) -> None:
    from ..recording.replay import DIFFERS, NOT_PLAYED, SAME

    print(f"{'':16}{SAME:>12}{DIFFERS:>12}{NOT_PLAYED:>12}")
    for method in sorted({method for method, _ in counts}):
        row = (counts[method, verdict] for verdict in (SAME, DIFFERS, NOT_PLAYED))
        print(f"{method:16}" + "".join(f"{count:>12,}" for count in row))
    print(f"recorded by heliographd {recording.header.daemon}, backend {recording.header.backend}")
    print(f"the recording {f'ends: {recording.reason}' if recording.reason else 'was cut short'}")
