"""The directory of scenes: names, who sees what, branches, retries."""

import grpc
import pytest
from conftest import Client, detail
from heliograph.v1 import types_pb2

NOT_FOUND = grpc.StatusCode.NOT_FOUND


@pytest.fixture
def other(daemon):
    opened = Client(daemon)
    yield opened
    opened.close()


def code_of(call) -> grpc.StatusCode:
    with pytest.raises(grpc.RpcError) as error:
        call()
    return error.value.code()


def test_a_scene_is_created_opened_and_deleted(client):
    info = client.call("CreateScene", name="demo")
    assert (info.name, info.revision) == ("demo", 0)
    assert info.lifetime == types_pb2.LIFETIME_SESSION
    assert info.next_edit == 1
    assert client.call("OpenScene", name="demo").scene == info.scene
    client.call("DeleteScene", scene=info.scene)
    assert code_of(lambda: client.call("OpenScene", name="demo")) == NOT_FOUND
    assert code_of(lambda: client.call("DeleteScene", scene=info.scene)) == NOT_FOUND


def test_a_name_is_taken_once(client):
    client.create("taken")
    assert code_of(lambda: client.create("taken")) == grpc.StatusCode.ALREADY_EXISTS


def test_an_unknown_name_lists_those_that_exist(client):
    client.create("bin-picking")
    with pytest.raises(grpc.RpcError) as error:
        client.call("OpenScene", name="bin-pickin")
    assert error.value.code() == NOT_FOUND
    assert "bin-picking" in detail(error.value).nearest
    assert detail(error.value).field == "name"


def test_ids_say_nothing_of_other_scenes(client):
    ids = [client.create(f"guess {i}") for i in range(8)]
    gaps = {abs(a - b) for a in ids for b in ids if a != b}
    assert min(gaps) > 1 << 20 and max(ids) < 1 << 53
    listed = [scene.scene for scene in client.call("ListScenes").scenes]
    assert [scene for scene in listed if scene in ids] == ids  # the oldest first


def test_sessions_of_a_tenant_see_each_others_scenes(client, other):
    """A forked or unpickled client has a session of its own and works on its parent's scenes."""
    scene = client.create("bins")
    assert other.call("OpenScene", name="bins").scene == scene
    assert "bins" in [s.name for s in other.call("ListScenes").scenes]
    assert other.call("DescribeScene", scene=scene).scene.next_edit == 1
    with pytest.raises(grpc.RpcError) as error:
        other.create("bins")
    assert error.value.code() == grpc.StatusCode.ALREADY_EXISTS
    client.call("CloseSession")
    assert code_of(lambda: other.call("DescribeScene", scene=scene)) == NOT_FOUND


def test_a_shared_scene_outlives_its_session(daemon, other):
    client = Client(daemon)
    scene = client.create("common", lifetime="LIFETIME_DAEMON")
    assert other.call("OpenScene", name="common").scene == scene
    client.call("CloseSession")
    client.close()
    assert other.call("OpenScene", name="common").lifetime == types_pb2.LIFETIME_DAEMON
    other.call("DeleteScene", scene=scene)


def test_a_repeated_request_id_is_answered_from_memory(client):
    first = client.call("CreateScene", name="once", request_id="a")
    again = client.call("CreateScene", name="once", request_id="a")
    assert first == again
    assert [s.name for s in client.call("ListScenes").scenes].count("once") == 1
    client.call("DeleteScene", scene=first.scene, request_id="b")
    client.call("DeleteScene", scene=first.scene, request_id="b")
    assert (
        code_of(lambda: client.call("DeleteScene", scene=first.scene, request_id="a"))
        == grpc.StatusCode.INVALID_ARGUMENT
    )


def test_a_failed_call_may_be_tried_again_under_its_request_id(client):
    scene = client.create("busy")
    assert (
        code_of(lambda: client.call("CreateScene", name="busy", request_id="c"))
        == grpc.StatusCode.ALREADY_EXISTS
    )
    client.call("DeleteScene", scene=scene)
    assert client.call("CreateScene", name="busy", request_id="c").scene != scene


@pytest.mark.parametrize(
    "lifetime,code",
    [
        ("LIFETIME_DISK", "FAILED_PRECONDITION"),
        ("LIFETIME_DISK_SYNCED", "FAILED_PRECONDITION"),
        (99, "UNIMPLEMENTED"),
    ],
)
def test_a_scene_on_disk_needs_a_state_directory(client, lifetime, code):
    with pytest.raises(grpc.RpcError) as error:
        client.call("CreateScene", lifetime=lifetime)
    assert error.value.code().name == code
    assert detail(error.value).field == "lifetime"


def test_scenes_are_limited(start):
    client = Client(start(limits={"scenes": 3}))
    for _ in range(3):
        client.create()
    assert code_of(client.create) == grpc.StatusCode.RESOURCE_EXHAUSTED
    client.close()
