"""Fixtures: a fake daemon, and a client and scene of it."""

import fake
import heliograph as hg
import native_dlpack
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


@pytest.fixture(scope="session")
def dlpack_library(tmp_path_factory):
    return native_dlpack.compiled(tmp_path_factory.mktemp("dlpack"))


@pytest.fixture
def dlpack(dlpack_library, monkeypatch):
    """The client finds clients/python/native/dlpack.c, compiled, beside its daemon."""
    with native_dlpack.found(dlpack_library, monkeypatch):
        yield native_dlpack
