"""Fixtures: a fake daemon, and a client and scene of it."""

import fake
import heliograph as hg
import pytest


@pytest.fixture
def daemon(tmp_path):
    with fake.running(tmp_path) as running:
        yield running


@pytest.fixture
def client(daemon):
    with hg.connect(daemon.address) as connected:
        yield connected


@pytest.fixture
def scene(client):
    return client.create_scene("demo")
