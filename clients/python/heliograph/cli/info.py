"""heliograph info: version, capabilities, readiness and use of a daemon, by tenant."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .._wire._proto import types_pb2 as types
from ._daemon import add_connection, connect

_LONG_SECONDS = 5400.0  # from here on hours


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "info",
        help="version, backend, readiness of a daemon, its limits and their use",
        description="Prints version, capabilities and readiness of a daemon, its limits and their "
        "use. Sessions and scenes are those of the caller's tenant.",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    client: Any = connect(arguments)
    with client:
        info = client.info()
        scenes, sessions = client.scene_infos(), client.sessions()
    if arguments.json:
        from google.protobuf.json_format import MessageToDict

        fields = MessageToDict(info, preserving_proto_field_name=True)
        fields["sessions"] = [
            MessageToDict(use, preserving_proto_field_name=True) for use in sessions
        ]
        print(json.dumps(fields, indent=2))
        return 0
    _print_server(info)
    _print_sessions(sessions)
    _print_scenes(scenes)
    print("limits of this tenant, and their use")
    for name in sorted(info.limits):
        used = f"{info.used[name]:>16,}" if name in info.used else ""
        print(f"  {name:<28}{info.limits[name]:>16,}{used}")
    return 0


def _apis(info: Any) -> str:
    """ "v1", or "v1 to v2"."""
    one = info.min_api == info.max_api
    return f"v{info.max_api}" if one else f"v{info.min_api} to v{info.max_api}"


def _tenant(info: Any) -> str:
    return f"{info.tenant}, weight {info.weight:g}" if info.tenant else "an older daemon: unknown"


def _durable(info: Any) -> str:
    if info.journal == info.JOURNAL_NONE:
        return "no scenes: it has no --state-dir"
    return (
        "writing" if info.journal == info.JOURNAL_WRITING else f"read-only: {info.journal_reason}"
    )


def _print_server(info: Any) -> None:
    rows = [
        ("version", f"{info.version} (api {_apis(info)})"),
        ("backend", f"{info.backend}, {info.cpu_features or 'features not known yet'}"),
        ("threads", str(info.threads)),
        ("tenant", _tenant(info)),
        ("ready", "yes" if info.ready else f"no: {info.not_ready}"),
        ("durable", _durable(info)),
        ("decoder", info.decoder),
        ("capabilities", ", ".join(info.capabilities) or "none"),
        ("refused", ", ".join(info.refused) or "nothing"),
    ]
    for name, value in rows:
        print(f"{name:<14}{value}")


def _print_sessions(sessions: Any) -> None:
    print(f"sessions: {len(sessions)}, this command's among them")
    print(f"  {'client':<44}{'open':>10}{'calls':>8}{'scenes':>8}")
    for session in sessions:
        row = f"{_duration(session.open_seconds):>10}{session.calls:>8}{session.scenes:>8}"
        print(f"  {session.client:<44.44}{row}")


def _print_scenes(scenes: Any) -> None:
    print(f"scenes: {len(scenes)}")
    for scene in scenes:
        lifetime = types.Lifetime.Name(scene.lifetime).removeprefix("LIFETIME_").lower()
        print(f"  {scene.name or '(no name)':<44.44} {lifetime}, revision {scene.revision:,}")


def _duration(seconds: float) -> str:
    return f"{seconds:,.0f} s" if seconds < _LONG_SECONDS else f"{seconds / 3600:,.1f} h"
