"""Watch on the wire: events, bookmarks, where it may begin, and what ends it."""

import threading
import time

import grpc
import pytest
from conftest import Client, Replies, detail, eventually
from heliograph.v1 import service_pb2 as service
from test_edits import entity, pose


def watching(client: Client, scene: int, **fields) -> Replies:
    return Replies(client.call("Watch", timeout=60, scene=scene, **fields))


@pytest.fixture
def watch(client):
    opened = []

    def make(scene: int, of: Client = client, **fields) -> Replies:
        opened.append(watching(of, scene, **fields))
        return opened[-1]

    yield make
    for each in opened:
        each.close()


def edit(client: Client, scene: int, x: float = 0):
    return client.apply(scene, entity("thing", pose=pose(x, 0, 0)))


def refused(client: Client, **fields) -> grpc.RpcError:
    with pytest.raises(grpc.RpcError) as error:
        list(client.call("Watch", **fields))
    return error.value


def test_events_are_what_was_sent_with_its_ids(client, watch):
    scene = client.create(lifetime="LIFETIME_DAEMON")
    sent = [entity("thing", pose=pose(1, 2, 3)), entity("other", visible=False)]
    reply = client.apply(scene, *sent)
    found = watch(scene, from_revision=1)
    first, event = found.wait(2)
    assert (first.revision, first.HasField("transaction")) == (0, False)
    assert list(event.transaction.edits) == sent
    assert (event.revision, event.ids, event.counts) == (reply.revision, reply.ids, reply.counts)
    edit(client, scene)
    assert found.wait(3)[2].revision == 2


def test_a_refused_edit_is_no_event(client, watch):
    scene = client.create()
    found = watch(scene)
    found.wait(1)
    with pytest.raises(grpc.RpcError):
        client.apply(scene, entity("thing", pose=pose(float("nan"), 0, 0)))
    edit(client, scene)
    assert [reply.revision for reply in found.wait(2)] == [0, 1]


def test_it_begins_now_when_no_revision_is_named(client, watch):
    scene = client.create(lifetime="LIFETIME_DAEMON")
    edit(client, scene)
    found = watch(scene)
    assert found.wait(1)[0].revision == 1
    edit(client, scene)
    assert [reply.revision for reply in found.wait(2)] == [1, 2]


def test_several_clients_edit_and_several_watch(daemon, client, watch):
    scene = client.create(lifetime="LIFETIME_DAEMON")
    clients = [Client(daemon) for _ in range(3)]
    watches = [watch(scene, of, from_revision=1) for of in clients]

    def work(of):
        for x in range(30):
            edit(of, scene, x)

    threads = [threading.Thread(target=work, args=(of,)) for of in clients]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for found in watches:
        assert [reply.revision for reply in found.wait(91)] == list(range(91))
    same = [[reply.SerializeToString() for reply in found.replies] for found in watches]
    assert same[0] == same[1] == same[2]
    for found, of in zip(watches, clients, strict=True):
        found.close()
        of.close()


def test_bookmarks_come_while_nothing_changes(client, watch):
    scene = client.create()
    found = watch(scene, bookmark_seconds=0.5)
    found.wait(1)
    edit(client, scene)
    eventually(lambda: len([r for r in found.replies if r.revision == 1]) >= 3)
    replies = found.replies[:]
    event = [reply.HasField("transaction") for reply in replies].index(True)
    assert [reply.revision for reply in replies] == [0] * event + [1] * (len(replies) - event)
    assert not any(reply.HasField("transaction") for reply in replies[event + 1 :])


@pytest.mark.parametrize("seconds", [0.4, 3601, -1, float("nan"), float("inf")])
def test_bookmarks_have_bounds(client, seconds):
    error = refused(client, scene=client.create(), bookmark_seconds=seconds)
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error).field == "bookmark_seconds"


def test_what_is_not_there_is_named(client):
    assert refused(client, scene=10**9).code() == grpc.StatusCode.NOT_FOUND
    scene = client.create(lifetime="LIFETIME_DAEMON")
    error = refused(client, scene=scene, from_revision=2)
    assert error.code() == grpc.StatusCode.OUT_OF_RANGE
    assert (detail(error).field, detail(error).expected) == ("from_revision", 1)


def test_a_private_scene_keeps_those_since_its_first_watch(client, watch):
    scene = client.create()
    edit(client, scene)
    error = refused(client, scene=scene, from_revision=1)
    assert (error.code(), detail(error).expected) == (grpc.StatusCode.OUT_OF_RANGE, 2)
    edit(client, scene)
    assert watch(scene, from_revision=2).wait(2)[1].revision == 2


def test_compacted_revisions_are_told_with_the_oldest(start, watch):
    client = Client(start(limits={"watch_events": 5}))
    scene = client.create(lifetime="LIFETIME_DAEMON")
    for x in range(20):
        edit(client, scene, x)
    error = refused(client, scene=scene, from_revision=15)
    assert error.code() == grpc.StatusCode.OUT_OF_RANGE
    assert "compacted" in error.details() and detail(error).expected == 16
    assert [r.revision for r in watch(scene, client, from_revision=16).wait(6)] == list(
        range(15, 21)
    )
    client.close()


def test_the_end_of_the_scene_ends_it_after_its_last_event(client, watch):
    scene = client.create(lifetime="LIFETIME_DAEMON")
    found = watch(scene)
    found.wait(1)
    edit(client, scene)
    client.call("DeleteScene", scene=scene)
    eventually(lambda: found.error)
    assert found.error.code() == grpc.StatusCode.NOT_FOUND
    assert [reply.revision for reply in found.replies] == [0, 1]


def test_the_daemon_drains_after_the_last_event(start):
    daemon = start()
    client = Client(daemon)
    scene = client.create(lifetime="LIFETIME_DAEMON")
    found = watching(client, scene)
    found.wait(1)
    for x in range(100):
        edit(client, scene, x)
    assert daemon.stop(timeout=8) == 0
    eventually(lambda: found.error)
    assert found.error.code() == grpc.StatusCode.UNAVAILABLE
    assert [reply.revision for reply in found.replies] == list(range(101))
    found.close()
    client.close()


def test_a_watch_counts_among_the_streams(start):
    client = Client(start(limits={"tenant_streams": 1}))
    scene = client.create()
    first = watching(client, scene)
    first.wait(1)
    error = refused(client, scene=scene)
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert "tenant_streams" in error.details()
    first.close()
    eventually(lambda: client.call("GetServerInfo").used["tenant_streams"] == 0)
    client.close()


def test_a_reader_that_takes_nothing_is_cancelled(start):
    client = Client(start(limits={"stall_seconds": 1}))
    scene = client.create()
    call = client.call("Watch", timeout=60, scene=scene)
    next(call)
    large = entity("thing", attributes={"values": {"a": "x" * 900_000}})
    for _ in range(40):
        client.apply(scene, large)
    eventually(lambda: client.call("GetServerInfo").used["tenant_streams"] == 0, 8)
    with pytest.raises(grpc.RpcError) as error:
        for _ in call:
            pass
    assert error.value.code() == grpc.StatusCode.CANCELLED
    client.close()


def test_the_session_ends_its_watches(daemon):
    client = Client(daemon)
    found = watching(client, client.create())
    found.wait(1)
    client.call("CloseSession")
    eventually(lambda: found.error)
    assert found.error.code() == grpc.StatusCode.CANCELLED
    client.close()


def test_a_cancelled_watch_costs_nothing(client):
    scene = client.create()
    for _ in range(20):
        call = client.call("Watch", scene=scene)
        next(call)
        call.cancel()
    eventually(lambda: client.call("GetServerInfo").used["tenant_streams"] == 0)
    start = time.monotonic()
    edit(client, scene)
    assert time.monotonic() - start < 1


def test_an_unknown_field_is_refused(client):
    request = service.WatchRequest(scene=client.create())
    unknown = service.WatchRequest.FromString(request.SerializeToString() + b"\xf8\x07\x01")
    with pytest.raises(grpc.RpcError) as error:
        list(client.call("Watch", unknown))
    assert error.value.code() == grpc.StatusCode.UNIMPLEMENTED
