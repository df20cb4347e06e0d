"""RenderBatch and Stream on the wire: credits, statuses, and what ends them."""

import hashlib
import os
import queue
import time

import grpc
import pytest
from conftest import Client, Replies, detail_of, eventually
from heliograph.v1 import service_pb2 as service
from test_edits import entity, pose
from test_render import request, setup


class Conversation(Replies):
    """A bidirectional call: send(), and what has come."""

    def __init__(self, client: Client, method: str):
        self.requests = queue.SimpleQueue()
        super().__init__(client.call(method, iter(self.requests.get, None), timeout=30))

    def send(self, message):
        self.requests.put(message)

    def half_close(self):
        self.requests.put(None)

    def close(self):
        self.half_close()
        super().close()


@pytest.fixture
def scene(client) -> int:
    return setup(client)


@pytest.fixture
def converse(client):
    opened = []

    def make(method: str) -> Conversation:
        opened.append(Conversation(client, method))
        return opened[-1]

    yield make
    for each in opened:
        each.close()


def item(scene: int, tag: int, **fields) -> service.RenderBatchRequest:
    return service.RenderBatchRequest(tag=tag, job=request(scene, "DEPTH"), **fields)


def done(batch: Conversation) -> list[int]:
    return [reply.tag for reply in batch.replies if reply.done]


def headers(stream: Conversation) -> list:
    return [part.header for part in stream.replies if part.HasField("header")]


def test_an_item_waits_for_its_credit(converse, scene):
    batch = converse("RenderBatch")
    batch.send(item(scene, 1, credits=1))
    for tag in (2, 3):
        batch.send(item(scene, tag))
    eventually(lambda: done(batch))
    time.sleep(0.3)
    assert done(batch) == [1]
    batch.send(service.RenderBatchRequest(credits=1))
    eventually(lambda: done(batch) == [1, 2])
    batch.half_close()
    eventually(lambda: batch.is_over)
    assert done(batch) == [1, 2, 3] and batch.error is None


def test_the_parts_of_an_item_come_before_its_status(converse, scene):
    batch = converse("RenderBatch")
    for tag in range(6):
        batch.send(item(scene, tag, credits=1))
    batch.half_close()
    eventually(lambda: batch.is_over)
    assert sorted(done(batch)) == list(range(6))
    for tag in range(6):
        mine = [reply for reply in batch.replies if reply.tag == tag]
        assert mine[0].part.HasField("header") and mine[-1].done and not mine[-1].HasField("status")
        assert len([reply for reply in mine if reply.done]) == 1


def test_an_item_has_a_status_of_its_own(converse, scene):
    batch = converse("RenderBatch")
    batch.send(item(scene + 10**6, 1, credits=2))
    wrong = item(scene, 2)
    wrong.job.progressive = True
    batch.send(wrong)
    batch.send(item(scene, 3))
    batch.half_close()
    eventually(lambda: batch.is_over)
    ends = {reply.tag: reply for reply in batch.replies if reply.done}
    assert ends[1].status.code == grpc.StatusCode.NOT_FOUND.value[0]
    assert detail_of(ends[1].status).field == "job.scene" and "no scene" in ends[1].status.message
    assert ends[2].status.code == grpc.StatusCode.INVALID_ARGUMENT.value[0]
    assert detail_of(ends[2].status).field == "job.progressive"
    assert not ends[3].HasField("status")


@pytest.mark.parametrize("method", ["RenderBatch", "Stream"])
def test_too_many_credits_end_the_call(converse, scene, method):
    call = converse(method)
    if method == "Stream":
        call.send(service.StreamRequest(settings=request(scene, "DEPTH"), credits=65))
    else:
        call.send(item(scene, 1, credits=65))
    eventually(lambda: call.is_over)
    assert call.error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert "limit credits" in call.error.details()


def test_more_than_may_wait_ends_the_call(start):
    client = Client(start(limits={"waiting_bytes": 10_000}))
    scene = setup(client)
    batch = Conversation(client, "RenderBatch")
    for tag in range(20):
        batch.send(item(scene, tag))
    eventually(lambda: batch.is_over)
    assert batch.error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert "waiting_bytes" in batch.error.details()
    batch.close()
    client.close()


def test_a_batch_that_is_cancelled_while_it_sends_is_gone(client, scene):
    """An item that came after the call's end kept the call, and its session, for good."""
    for after in range(150):
        items = (item(scene, tag) for tag in range(1000))
        batch = client.call("RenderBatch", items)
        time.sleep(after * 2e-5)
        batch.cancel()
    eventually(lambda: client.call("GetServerInfo").used["tenant_streams"] == 0)


def test_a_frame_waits_for_its_credit(client, converse, scene):
    stream = converse("Stream")
    stream.send(service.StreamRequest(settings=request(scene, "DEPTH"), credits=1))
    eventually(lambda: headers(stream))
    for distance in (3, 4, 5):
        revision = client.apply(scene, entity("thing", pose=pose(0, 0, -distance))).revision
    time.sleep(0.3)
    assert len(headers(stream)) == 1
    stream.send(service.StreamRequest(credits=1))
    eventually(lambda: len(headers(stream)) == 2)
    assert headers(stream)[1].revision == revision  # the newest, not the next


@pytest.mark.parametrize(
    "first,field",
    [
        (service.StreamRequest(credits=1), "settings"),
        (service.StreamRequest(settings={"scene": 1}, policy=99), "policy"),
        (
            service.StreamRequest(settings={"progressive": True}, policy="POLICY_LOSSLESS"),
            "settings.progressive",
        ),
        (service.StreamRequest(settings={"scene": 10**9}), "settings.scene"),
    ],
)
def test_a_wrong_first_message_ends_the_stream(converse, first, field):
    stream = converse("Stream")
    stream.send(first)
    eventually(lambda: stream.is_over)
    assert stream.error is not None and stream.error.details().startswith(field + ":")


def test_half_closing_ends_a_stream_after_its_last_frame(client, converse, scene):
    stream = converse("Stream")
    stream.send(service.StreamRequest(settings=request(scene, "DEPTH"), credits=1))
    for seed in range(1, 4):
        stream.send(service.StreamRequest(settings=request(scene, "DEPTH", seed=seed)))
    stream.half_close()
    eventually(lambda: stream.is_over)
    assert stream.error is None and headers(stream)[-1].seed == 3


def test_a_stream_ends_when_the_daemon_drains(start):
    daemon = start()
    client = Client(daemon)
    stream = Conversation(client, "Stream")
    stream.send(service.StreamRequest(settings=request(setup(client), "DEPTH")))
    eventually(lambda: headers(stream))
    assert daemon.stop(timeout=5) == 0
    eventually(lambda: stream.is_over)
    assert stream.error.code() == grpc.StatusCode.UNAVAILABLE
    stream.close()
    client.close()


# ---------------------------------------------------------------- what outlives its permission


def numbered(scene: int, number: int) -> service.ApplyRequest:
    request = service.ApplyRequest(scene=scene, number=number)
    request.transaction.edits.append(entity(f"e{number}"))
    return request


class Edits:
    """An ApplyStream of a shared scene that has taken one edit, and waits."""

    def __init__(self, client: Client):
        self.scene = client.create("shared", lifetime="LIFETIME_DAEMON")
        self.stream = Conversation(client, "ApplyStream")
        self.stream.send(numbered(self.scene, 1))
        assert self.stream.wait(1)[0].status.code == 0

    def try_another(self) -> int:
        """The status of a second edit, as a reply or as the stream's end."""
        self.stream.send(numbered(self.scene, 2))
        eventually(lambda: self.stream.is_over or len(self.stream.replies) == 2)
        if len(self.stream.replies) == 2:
            return self.stream.replies[1].status.code
        return self.stream.error.code().value[0]

    def end(self) -> grpc.RpcError:
        eventually(lambda: self.stream.is_over, 2)
        return self.stream.error


@pytest.mark.parametrize("waits", [False, True])
def test_an_apply_stream_ends_with_its_session(daemon, client, waits):
    other = Client(daemon)
    edits = Edits(other)
    other.call("CloseSession")
    if not waits:
        assert edits.try_another() == grpc.StatusCode.CANCELLED.value[0]
    assert edits.end().code() == grpc.StatusCode.CANCELLED
    found = client.call("OpenScene", name="shared")
    assert (found.revision, found.next_edit) == (1, 1)
    client.call("DeleteScene", scene=found.scene)
    edits.stream.close()
    other.close()


def test_an_idle_apply_stream_does_not_hold_the_drain(start):
    daemon = start("--drain", "20")
    client = Client(daemon)
    edits = Edits(client)
    begin = time.monotonic()
    assert daemon.stop() == 0
    assert time.monotonic() - begin < 3
    assert edits.end().code() == grpc.StatusCode.UNAVAILABLE
    edits.stream.close()
    client.close()


def test_an_edit_of_an_open_stream_is_refused_while_the_daemon_drains(start):
    daemon = start("--drain", "20")
    client = Client(daemon)
    edits = Edits(client)
    daemon.process.terminate()
    time.sleep(0.1)
    assert edits.try_another() == grpc.StatusCode.UNAVAILABLE.value[0]
    assert daemon.process.wait(5) == 0
    edits.stream.close()
    client.close()


def test_an_import_after_its_session_leaves_nothing(daemon, client):
    chunks = list(client.call("ExportScene", scene=client.create()))
    chunks[0].header.name = "orphan"
    other = Client(daemon)
    sent = queue.SimpleQueue()
    imported = other.stub.ImportScene.future(
        iter(sent.get, None), metadata=other.metadata, timeout=10
    )
    for chunk in chunks:
        sent.put(chunk)
    time.sleep(0.2)  # it is let in
    other.call("CloseSession")
    sent.put(None)
    assert imported.exception(timeout=5).code() == grpc.StatusCode.CANCELLED
    assert "orphan" not in [scene.name for scene in client.call("ListScenes").scenes]
    other.close()


TOKENS = ["first" * 5, "second" * 5]


def write_tenants(path: str, lines: list[tuple[str, str]]):
    """Replaces the tenants file."""
    with open(path + ".new", "w", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
        for tenant, token in lines:
            file.write(f"{tenant} token sha256:{hashlib.sha256(token.encode()).hexdigest()}\n")
    os.rename(path + ".new", path)


@pytest.mark.parametrize("left", ["another token", "another tenant"])
def test_streams_end_with_the_token_that_opened_them(start, tmp_path, left):
    tenants = str(tmp_path / "tenants")
    keeper = "robots" if left == "another token" else "vision"
    write_tenants(tenants, [("robots", TOKENS[0]), (keeper, TOKENS[1])])
    daemon = start("--tenants", tenants)
    client = Client(daemon, token=TOKENS[0])
    edits = Edits(client)
    watch = Replies(client.call("Watch", timeout=60, scene=edits.scene))
    watch.wait(1)
    batch = Conversation(client, "RenderBatch")
    batch.send(item(edits.scene + 1, 1, credits=1))
    batch.wait(1)
    write_tenants(tenants, [(keeper, TOKENS[1])])
    gone = {grpc.StatusCode.UNAUTHENTICATED}
    if left == "another tenant":
        gone.add(grpc.StatusCode.CANCELLED)  # its sessions end too
    assert edits.end().code() in gone
    for call in (watch, batch):
        eventually(lambda call=call: call.is_over, 2)
        assert call.error.code() in gone
    for call in (edits.stream, watch, batch):
        call.close()
    client.close()
