"""heliograph info: what a daemon is and can do."""

from __future__ import annotations

import argparse
from typing import Any

from . import add_connection, connect


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "info", help="version, backend, limits and sandbox of a daemon", description=__doc__
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    client: Any = connect(arguments)
    with client:
        info = client.info()
    if arguments.json:
        from google.protobuf.json_format import MessageToJson

        print(MessageToJson(info, preserving_proto_field_name=True))
        return 0
    rows = [
        ("version", f"{info.version} (api {info.api})"),
        ("backend", f"{info.backend}, {info.cpu_features or 'features not known yet'}"),
        ("threads", str(info.threads)),
        ("ready", "yes" if info.ready else "not yet: no pixel was rendered"),
        ("decoder", info.decoder),
        ("capabilities", ", ".join(info.capabilities) or "none"),
        ("refused", ", ".join(info.refused) or "nothing"),
    ]
    for name, value in rows:
        print(f"{name:<14}{value}")
    print("limits, and what is used of them")
    for name in sorted(info.limits):
        used = f"{info.used[name]:>16,}" if name in info.used else ""
        print(f"  {name:<28}{info.limits[name]:>16,}{used}")
    return 0
