"""Quick calls: Apply and Render over a socket of the session's own, a packet each way."""

import os
import signal
import socket
import struct
import threading
import time

import grpc
import numpy as np
import pytest
from conftest import Client, eventually, status_of
from heliograph.v1 import render_pb2, scene_pb2
from heliograph.v1 import service_pb2 as service
from test_edits import entity, named, pose
from test_operation import scrape
from test_render import collect, request, setup

WISH = struct.pack("=QQ", 0, 1)
PACKET = 64 << 10
NOT_FOUND = grpc.StatusCode.NOT_FOUND.value[0]
UNAVAILABLE = grpc.StatusCode.UNAVAILABLE.value[0]


class Line:
    """A session's socket for quick calls."""

    def __init__(self, client: Client, kind: int = socket.SOCK_SEQPACKET):
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, kind)
        self.socket.settimeout(20)
        with theirs:
            socket.send_fds(client.local_channel, [WISH], [theirs.fileno()])

    def exchange(self, packet: bytes) -> bytes | None:
        """The answer to a packet; None: the daemon closed the socket."""
        try:
            self.socket.send(packet)
            data, fds, _, _ = socket.recv_fds(self.socket, PACKET, 1)
        except (BrokenPipeError, ConnectionResetError):
            return None
        if not fds:
            return data or None
        self.was_memory = True
        with open(fds[0], "rb") as memory:
            return os.pread(memory.fileno(), struct.unpack("=Q", data)[0], 0)

    def ask(self, **fields) -> service.QuickReply:
        answer = self.exchange(service.QuickCall(**fields).SerializeToString())
        assert answer is not None, "the daemon closed the socket"
        return service.QuickReply.FromString(answer)

    def ping(self) -> int | None:
        """The code of a call that asks for nothing there is; None: the daemon closed the socket."""
        nothing = service.QuickCall(render=render_pb2.RenderRequest())
        answer = self.exchange(nothing.SerializeToString())
        return None if answer is None else service.QuickReply.FromString(answer).status.code

    def close(self):
        self.socket.close()


@pytest.fixture
def line(client):
    made = Line(client)
    yield made
    made.close()


def moved(scene: int, number: int, z: float, **fields) -> service.ApplyRequest:
    edits = [entity("thing", pose=pose(0, 0, z))]
    transaction = scene_pb2.Transaction(edits=edits)
    return service.ApplyRequest(scene=scene, number=number, transaction=transaction, **fields)


def calls_of(client: Client) -> int:
    """Calls in flight of the tenant's sessions, this one not counted."""
    return sum(use.calls for use in client.call("ListSessions").sessions)


def test_an_edit_and_its_frame_are_those_of_grpc(client, line):
    scene = setup(client)
    reply = line.ask(apply=moved(scene, 2, -3))
    assert (reply.status.code, reply.apply.number) == (0, 2)
    assert reply.apply.revision == client.revision(scene)
    assert line.ask(apply=moved(scene, 2, -3)).apply == reply.apply  # answered, not done twice

    asked = request(scene, "DEPTH", "INSTANCE", "BEAUTY", spp=4)
    [(quick, ours)] = collect(line.ask(render=asked).parts)
    [(usual, theirs)] = collect(client.call("Render", asked))
    assert quick.revision == usual.revision == reply.apply.revision
    for name, plane in theirs.items():
        np.testing.assert_array_equal(ours[name], plane)


def test_frames_of_all_cameras_come_in_one_reply(client, line):
    scene = setup(client)
    asked = request(scene, "DEPTH")
    asked.cameras.append(named("cam"))
    assert len(collect(line.ask(render=asked).parts)) == 2


def test_a_reply_larger_than_a_packet_comes_in_memory(client, line):
    scene = setup(client)
    asked = request(scene, "POSITION", width=320, height=240)
    [(_, planes)] = collect(line.ask(render=asked).parts)
    assert line.was_memory
    [(_, theirs)] = collect(client.call("Render", asked))
    np.testing.assert_array_equal(planes["position"], theirs["position"])


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: {"apply": moved(scene, 7, -3)},
        lambda scene: {"apply": moved(scene + 1, 2, -3)},
        lambda scene: {"apply": moved(scene, 2, float("nan"))},
        lambda scene: {"apply": moved(scene, 2, -3, expected_revision=99)},
        lambda scene: {"render": request(scene, "DEPTH", revision=99)},
        lambda scene: {"render": request(scene, "BEAUTY")},
        lambda scene: {"render": request(scene, "DEPTH", width=1 << 20, height=1)},
    ],
    ids=["gap", "no scene", "nan", "revision", "no revision", "no stop rule", "size"],
)
def test_a_refusal_is_that_of_grpc(client, line, call):
    scene = setup(client)
    [(kind, asked)] = call(scene).items()
    reply = line.ask(**{kind: asked})
    with pytest.raises(grpc.RpcError) as error:
        answer = client.call(kind.capitalize(), asked)
        list(answer) if kind == "render" else None
    assert reply.status == status_of(error.value)


def test_what_this_version_does_not_know_is_refused(client, line):
    future = struct.pack("=BBB", 0xB8, 0x7C, 1)  # field 1991, varint 1
    for call in (service.QuickCall(), service.QuickCall(apply=moved(setup(client), 2, -3))):
        answer = line.exchange(call.SerializeToString() + future)
        reply = service.QuickReply.FromString(answer)
        assert reply.status.code == grpc.StatusCode.UNIMPLEMENTED.value[0]


@pytest.mark.parametrize("packet", [b"\xff" * 9, b"\x12" + b"\xff" * 100, b"\0" * (PACKET + 1)])
def test_what_is_no_call_closes_the_socket_alone(client, packet):
    line = Line(client)
    assert line.exchange(packet) is None
    scene = setup(client)
    assert Line(client).ask(apply=moved(scene, 2, -3)).status.code == 0


def test_a_second_call_beside_the_first_closes_the_socket(client):
    line = Line(client)
    endless = request(setup(client), "BEAUTY", seconds=60, spp=1 << 20)
    for _ in range(2):
        line.socket.send(service.QuickCall(render=endless).SerializeToString())
    assert line.socket.recv(PACKET) == b""
    eventually(lambda: calls_of(client) == 0)  # and cancels that one


def test_closing_the_socket_cancels_its_call(client):
    line = Line(client)
    endless = request(setup(client), "BEAUTY", seconds=60, spp=1 << 20)
    line.socket.send(service.QuickCall(render=endless).SerializeToString())
    eventually(lambda: calls_of(client) == 1)
    line.close()
    eventually(lambda: calls_of(client) == 0)


def test_the_end_of_the_session_closes_it(daemon):
    client = Client(daemon)
    line = Line(client)
    assert line.ping() == NOT_FOUND
    client.call("CloseSession")
    assert line.ping() is None
    client.close()


def test_a_new_socket_takes_the_place_of_the_old_one(client):
    old, new = Line(client), Line(client)
    assert new.ping() == NOT_FOUND
    assert old.ping() is None
    assert new.ping() == NOT_FOUND


def test_only_a_socket_of_packets_will_do(client):
    assert Line(client, socket.SOCK_STREAM).ping() is None
    with open("/dev/zero", "rb") as file:
        socket.send_fds(client.local_channel, [WISH], [file.fileno()])
    assert Line(client).ping() == NOT_FOUND


def test_a_reader_of_nothing_is_left(client):
    """Replies that nobody takes fill the socket; then it is closed, and the daemon goes on."""
    line = Line(client)
    scene = setup(client)
    asked = request(scene, "DEPTH", width=120, height=100)
    packet = service.QuickCall(render=asked).SerializeToString()
    with pytest.raises((BrokenPipeError, ConnectionResetError)):
        for _ in range(200):
            line.socket.send(packet)
            eventually(lambda: calls_of(client) == 0)
    assert Line(client).ask(apply=moved(scene, 2, -3)).status.code == 0


def test_many_sessions_at_once(daemon):
    def work(k: int):
        client = Client(daemon)
        line, scene = Line(client), setup(client)
        for number in range(2, 40):
            assert line.ask(apply=moved(scene, number, -number)).status.code == 0
            [(_, planes)] = collect(line.ask(render=request(scene, "DEPTH")).parts)
            good[k] += abs(planes["depth"].min() - number) < 1e-4
        client.close()

    good = [0] * 8
    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(good))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert good == [38] * 8


def test_there_are_none_while_calls_are_recorded(start, tmp_path):
    assert "quick_calls" in Client(start()).opened.server.capabilities
    client = Client(start("--record", str(tmp_path / "calls")))
    assert "quick_calls" not in client.opened.server.capabilities
    assert Line(client).ping() is None


def test_a_limit_of_sockets(start):
    daemon = start("--grace", "0.1", limits={"quick_calls": 1})
    first, second = Client(daemon), Client(daemon)
    line = Line(first)
    assert line.ping() == NOT_FOUND
    assert Line(second).ping() is None
    line.close()
    eventually(lambda: Line(second).ping() == NOT_FOUND)


def test_a_call_is_refused_while_the_daemon_drains(start):
    daemon = start("--drain", "20")
    busy, late = Client(daemon), Client(daemon)
    first, second = Line(busy), Line(late)
    asked = request(setup(busy), "BEAUTY", seconds=1.5, spp=1 << 20)
    first.socket.send(service.QuickCall(render=asked).SerializeToString())
    assert second.ping() == NOT_FOUND
    eventually(lambda: calls_of(late) == 1)
    daemon.process.send_signal(signal.SIGTERM)
    eventually(lambda: second.ping() == UNAVAILABLE)
    reply = service.QuickReply.FromString(first.socket.recv(PACKET))  # the work is done first
    assert reply.status.code == 0 and len(collect(reply.parts)) == 1
    assert daemon.process.wait(10) == 0


def test_each_call_says_who_makes_it(start, tmp_path):
    tenants = tmp_path / "tenants"
    tenants.write_text("one socket\n")
    tenants.chmod(0o600)
    daemon = start("--tenants", str(tenants))
    client = Client(daemon)
    line = Line(client)
    assert line.ping() == NOT_FOUND
    wrong = line.ask(token="guessed", apply=moved(1, 1, 0))
    assert wrong.status.code == grpc.StatusCode.UNAUTHENTICATED.value[0]
    assert "guessed" not in wrong.status.message
    assert not wrong.HasField("apply")


def test_they_are_counted_and_logged_as_all_calls_are(start):
    daemon = start("--metrics", "127.0.0.1:0", "--log-level", "debug")
    client = Client(daemon)
    line, scene = Line(client), setup(client)
    name = 'heliograph_calls_total{code="%s",method="%s"}'
    # setup's own is counted when gRPC has let go of it
    before = eventually(lambda: scrape(daemon).get(name % ("OK", "Apply")))
    for number in (2, 3, 9):
        line.ask(apply=moved(scene, number, -3))
    after = scrape(daemon)
    assert after[name % ("OK", "Apply")] == before + 2
    assert after[name % ("ABORTED", "Apply")] == 1
    client.close()
    assert daemon.stop() == 0
    log = daemon.process.stderr.read()
    refused = next(line for line in log.splitlines() if "ABORTED" in line)
    assert 'method="/heliograph.v1.Renderer/Apply"' in refused and f'scene="{scene}"' in refused
    assert 'tenant="local" client="test" peer="unix:"' in refused


def test_a_frame_of_a_job_that_ends_with_time(client, line):
    """A stop rule of the request's own holds as it does by gRPC."""
    start = time.monotonic()
    asked = request(setup(client), "BEAUTY", seconds=0.2, spp=1 << 20)
    reply = line.ask(render=asked)
    assert reply.status.code == 0 and 0.15 < time.monotonic() - start < 5
    assert isinstance(reply.parts[0], render_pb2.FramePart)


def test_progress_comes_before_the_reply(client, line):
    asked = request(setup(client), "BEAUTY", seconds=0.3, spp=1 << 20)
    line.socket.send(service.QuickCall(render=asked, progress=True).SerializeToString())
    replies = [service.QuickReply.FromString(line.socket.recv(PACKET))]
    while replies[-1].HasField("progress"):
        replies.append(service.QuickReply.FromString(line.socket.recv(PACKET)))
    assert len(replies) > 2
    assert len(collect(replies[-1].parts)) == 1


def test_an_idle_socket_holds_no_scene(client, line):
    """Memory of the last frame's scene is freed with it."""
    scene = setup(client)
    assert line.ask(render=request(scene, "DEPTH")).status.code == 0
    held = client.call("GetServerInfo").used["tenant_entities"]
    client.call("DeleteScene", scene=scene)
    eventually(lambda: client.call("GetServerInfo").used["tenant_entities"] < held)
