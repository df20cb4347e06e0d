"""The command scripts/replay: plays a daemon's recording and compares the answers."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence

from heliograph import cli
from heliograph.cli._daemon import EXIT_FAILED, add_connection, connect

from .reader import Recording
from .replay import DIFFERS, NOT_PLAYED, SAME, replay

_PLENTY = ("--limit", "connections=4096", "--limit", "connections_per_peer=4096")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; its exit status."""
    parser = argparse.ArgumentParser(
        prog="scripts/replay",
        description="Plays a recording of `heliographd --record` against a private daemon, or the "
        "one at --address, and tells of each call whether its answer is the same: revisions, ids, "
        "statuses, and every pixel. The same program on the same CPU gives the same.",
        epilog="Exit status: 0 the same, 1 different or failed, 2 wrong usage, 130 interrupted.",
    )
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--each", action="store_true", help="a line for every call")
    parser.add_argument("--tenant", metavar="NAME", help="whose calls, of a daemon of several")
    parser.add_argument(
        "--asset-root", metavar="DIR", help="of a private daemon, where the recorded one had one"
    )
    add_connection(parser)
    parser.set_defaults(run=_run)
    return cli.run(parser.parse_args(argv))


def _run(arguments: argparse.Namespace) -> int:
    recording = Recording(arguments.file)
    counts: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(prefix="heliograph-") as folder:
        with connect(arguments, _flags(recording, arguments, folder)) as client:
            for outcome in replay(recording, client, arguments.tenant):
                counts[outcome.call.method, outcome.verdict] += 1
                if outcome.verdict == DIFFERS or arguments.each:
                    print(f"{outcome.what}: {outcome.verdict}" + _because(outcome.text))
    _print_summary(recording, counts)
    return EXIT_FAILED if any(verdict == DIFFERS for _, verdict in counts) else 0


def _flags(recording: Recording, arguments: argparse.Namespace, folder: str) -> list[str]:
    """Flags of a private daemon like the one that recorded."""
    if arguments.address is not None:
        return []
    flags = [f"--limit={name}={value}" for name, value in recording.header.limits.items()]
    flags += [*_PLENTY, "--state-dir", f"{folder}/state"]
    return flags + (["--asset-root", arguments.asset_root] if arguments.asset_root else [])


def _because(text: str) -> str:
    return f": {text}" if text else ""


def _print_summary(recording: Recording, counts: Counter[tuple[str, str]]) -> None:
    print(f"{'':16}{SAME:>12}{DIFFERS:>12}{NOT_PLAYED:>12}")
    for method in sorted({method for method, _ in counts}):
        row = (counts[method, verdict] for verdict in (SAME, DIFFERS, NOT_PLAYED))
        print(f"{method:16}" + "".join(f"{count:>12,}" for count in row))
    print(f"recorded by heliographd {recording.header.daemon}, backend {recording.header.backend}")
    print(f"the recording {f'ends: {recording.reason}' if recording.reason else 'was cut short'}")
