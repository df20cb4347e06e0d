"""Sessions: how they open, what carries them, and what their end frees."""

import concurrent.futures
import os
import subprocess
import sys
import textwrap

import grpc
import pytest
from conftest import STUBS, Client, detail, eventually
from heliograph.v1 import service_pb2 as service

UNAUTHENTICATED = grpc.StatusCode.UNAUTHENTICATED


def test_a_call_without_a_session_says_how_to_open_one(client):
    with pytest.raises(grpc.RpcError) as error:
        client.stub.ListScenes(service.ListScenesRequest(), timeout=5)
    assert error.value.code() == UNAUTHENTICATED
    assert "OpenSession" in error.value.details()


@pytest.mark.parametrize("session", ["1", "", "abc", "-1", "99999999999999999999999"])
def test_a_guessed_session_is_refused(client, session):
    with pytest.raises(grpc.RpcError) as error:
        client.stub.ListScenes(
            service.ListScenesRequest(), timeout=5, metadata=[("heliograph-session", session)]
        )
    assert error.value.code() == UNAUTHENTICATED


def test_the_server_tells_versions_and_limits(client):
    info = client.call("GetServerInfo")
    assert info.max_api == 1 and info.version
    assert info.limits["message_bytes"] == 16 << 20
    assert info.limits["replies"] == 1024
    assert info.instance == client.opened.instance


def test_a_ticket_is_good_once(daemon, client):
    with pytest.raises(grpc.RpcError) as error:
        client.stub.OpenSession(service.OpenSessionRequest(ticket=b"0" * 16), timeout=5)
    assert error.value.code() == UNAUTHENTICATED
    other = Client(daemon)
    other.local_channel.close()  # its ticket was used by its own session
    other.channel.close()


def test_close_ends_the_session_at_once(daemon):
    client = Client(daemon)
    client.create("closing")
    client.call("CloseSession")
    with pytest.raises(grpc.RpcError) as error:
        client.call("ListScenes")
    assert error.value.code() == UNAUTHENTICATED
    client.close()


def test_the_end_of_the_local_channel_ends_the_session_after_its_grace_time(daemon):
    client = Client(daemon)
    client.create("dying")
    client.local_channel.close()
    client.local_channel = None
    client.call("ListScenes")  # within the grace time it still answers

    def is_over():
        try:
            client.call("ListScenes")
        except grpc.RpcError as error:
            return error.code() == UNAUTHENTICATED
        return False

    eventually(is_over)
    client.close()


def test_a_killed_client_leaves_no_private_scene(start):
    daemon = start("--grace", "0.1", limits={"scenes": 2})
    script = textwrap.dedent(f"""
        import sys, os, signal
        sys.path[:0] = [{str(STUBS)!r}, {os.path.dirname(__file__)!r}]
        from conftest import Client
        class D: socket = {daemon.socket!r}; target = "unix:" + socket
        client = Client(D)
        client.create("mine"); client.create("other")
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    assert subprocess.run([sys.executable, "-c", script]).returncode == -9
    client = Client(daemon)

    def there_is_room_again():
        try:
            return client.create()
        except grpc.RpcError as error:
            assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        return None

    eventually(there_is_room_again)
    client.close()


def test_keep_session_carries_a_session_without_a_ticket(start):
    daemon = start("--grace", "0.1")
    client = Client(daemon, ticket=False)
    stream = client.stub.KeepSession(service.KeepSessionRequest(), metadata=client.metadata)
    list(stream.initial_metadata())  # it is open
    client.create("kept")
    stream.cancel()

    def is_over():
        try:
            client.call("ListScenes")
        except grpc.RpcError as error:
            return error.code() == UNAUTHENTICATED
        return False

    eventually(is_over)
    client.close()


def test_keep_session_ends_with_close_session(daemon):
    client = Client(daemon, ticket=False)
    stream = client.stub.KeepSession(service.KeepSessionRequest(), metadata=client.metadata)
    list(stream.initial_metadata())
    client.call("CloseSession")
    assert list(stream) == []
    client.close()


def test_sessions_are_limited(start):
    daemon = start(limits={"sessions": 2})
    clients = [Client(daemon), Client(daemon)]
    with pytest.raises(grpc.RpcError) as error:
        Client(daemon)
    assert error.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert "limit sessions" in error.value.details()
    found = detail(error.value)
    assert (found.reason, found.limit, found.allowed) == ("LIMIT_EXCEEDED", "sessions", 2)
    assert (found.needed, found.used) == (1, 2)
    for client in clients:
        client.close()


def test_an_unknown_field_is_refused_with_its_path(client):
    request = service.CreateSceneRequest(name="x")
    message = service.CreateSceneRequest.FromString(request.SerializeToString() + b"\xf8\x07\x01")
    with pytest.raises(grpc.RpcError) as error:
        client.call("CreateScene", message)
    assert error.value.code() == grpc.StatusCode.UNIMPLEMENTED
    assert "127" in error.value.details()


def test_as_many_callers_as_calls_are_allowed_are_never_refused(start):
    client = Client(start(limits={"calls_per_session": 2}))
    scene = client.create()

    def call_often():
        for _ in range(1000):
            client.call("DescribeScene", scene=scene)

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        for caller in [pool.submit(call_often) for _ in range(2)]:
            caller.result()
    client.close()
