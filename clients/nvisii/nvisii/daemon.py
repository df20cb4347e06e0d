"""The client that initialize() opens and deinitialize() closes. Used by session and models."""

from __future__ import annotations

import heliograph as hg

# Scripts show new meshes and textures in every picture; none asks for a revision of before.
_PRIVATE = ("--limit", "revisions=1")
NOT_INITIALIZED = "nvisii is not initialized: call nvisii.initialize(headless=True) first"
_client: hg.Client | None = None


def open_client(address: str | None) -> hg.Client:
    """Connects to the daemon at `address`, or starts a private one for None."""
    global _client
    _client = hg.connect(address, arguments=() if address else _PRIVATE)
    return _client


def client() -> hg.Client:
    """The open client; RuntimeError where there is none."""
    if _client is None:
        raise RuntimeError(NOT_INITIALIZED)
    return _client


def close_client() -> None:
    """Leaves the daemon; without a client it does nothing."""
    global _client
    if _client is not None:
        closing, _client = _client, None
        closing.close()
