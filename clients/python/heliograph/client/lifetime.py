"""Lifetimes of scenes, by the names that users know. Used by client.py and scene.py."""

from __future__ import annotations

from typing import Any, Literal

from .._wire._proto import types_pb2 as types
from ..errors import InvalidArgument

Lifetime = Literal["session", "daemon", "disk", "disk_synced"]
NAMES: dict[int, Lifetime] = {
    types.LIFETIME_SESSION: "session",
    types.LIFETIME_DAEMON: "daemon",
    types.LIFETIME_DISK: "disk",
    types.LIFETIME_DISK_SYNCED: "disk_synced",
}


def lifetime_of(name: str) -> Any:
    """The contract's value."""
    if name not in NAMES.values():
        known = ", ".join(NAMES.values())
        raise InvalidArgument(f"lifetime: {name!r} is not one of {known}", field="lifetime")
    return types.Lifetime.Value(f"LIFETIME_{name.upper()}")
