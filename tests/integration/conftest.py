"""Fixtures of the tests against a real daemon: the one that $HELIOGRAPHD names."""

import heliograph as hg
import pytest
import replicas
from nvisii_world import camera
from recordings import recorded, short
from refusals import furnished, world

__all__ = ["camera", "furnished", "recorded", "short", "world"]


@pytest.fixture(scope="module")
def client():
    with hg.connect() as connected:
        yield connected


@pytest.fixture
def scene(client):
    with client.create_scene() as made:
        yield made


@pytest.fixture(scope="module")
def room(client):
    """The scene of replicas.py."""
    with client.create_scene() as made:
        replicas.furnish(made)
        yield made
