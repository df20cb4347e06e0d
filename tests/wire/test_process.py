"""The process: sockets, flags, signals, the owner, floods."""

import contextlib
import os
import signal
import socket
import stat
import subprocess
import time

import grpc
import pytest
from conftest import DAEMON, Client, eventually
from heliograph.v1 import service_pb2 as service
from heliograph.v1 import service_pb2_grpc


def run(*flags: str) -> subprocess.CompletedProcess:
    return subprocess.run([DAEMON, *flags], capture_output=True, text=True, timeout=20)


def test_sockets_are_private(start):
    daemon = start()
    for path in (daemon.socket, daemon.socket + ".fd.sock"):
        mode = os.stat(path).st_mode
        assert stat.S_ISSOCK(mode) and stat.S_IMODE(mode) == 0o600
    assert daemon.stop() == 0
    assert not os.listdir(os.path.dirname(daemon.socket))


def test_the_folder_of_the_sockets_is_made_private(tmp_path):
    folder = tmp_path / "new"
    read, write = os.pipe()
    process = subprocess.Popen(
        [DAEMON, "--socket", folder / "s", "--ready-fd", str(write)], pass_fds=(write,)
    )
    os.close(write)
    assert os.read(read, 1)
    assert stat.S_IMODE(os.stat(folder).st_mode) == 0o700
    process.terminate()
    assert process.wait(10) == 0
    os.close(read)


def test_nothing_is_announced_where_the_state_is_damaged(tmp_path):
    """Who waits for the line finds a daemon that has its scenes back."""
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    (state / "journal.db").write_bytes(b"no database" * 1000)
    read, write = os.pipe()
    flags = ["--socket", tmp_path / "new" / "s", "--ready-fd", str(write), "--state-dir", state]
    process = subprocess.Popen([DAEMON, *flags], pass_fds=(write,), stderr=subprocess.DEVNULL)
    os.close(write)
    assert os.read(read, 1) == b""
    assert process.wait(10) == 65
    os.close(read)


@pytest.mark.parametrize("address", ["0.0.0.0:7443", "[::]:7443", "192.168.1.5:7443", ":7443"])
def test_a_routable_address_is_refused(tmp_path, address):
    result = run("--socket", str(tmp_path / "s"), "--listen", address)
    assert result.returncode == 64
    assert "--tls-cert" in result.stderr or "numerical" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "flags",
    [
        ["--nonsense"],
        ["--limit", "scenes"],
        ["--limit", "scenes=0"],
        ["--limit", "nope=3"],
        ["--grace", "-1"],
        ["--socket", "/tmp/" + "x" * 120],
        ["--backend", "nope"],
    ],
)
def test_wrong_flags_exit_64(flags):
    result = run(*flags)
    assert result.returncode == 64, result.stderr
    assert result.stderr


def test_a_folder_that_others_may_write_is_refused(tmp_path):
    os.chmod(tmp_path, 0o777)
    result = run("--socket", str(tmp_path / "s"))
    assert result.returncode == 64
    assert "writable" in result.stderr


def test_a_second_daemon_leaves_the_first_alone(start):
    daemon = start()
    result = run("--socket", daemon.socket)
    assert result.returncode == 69
    assert "already listens" in result.stderr
    Client(daemon).close()


def test_a_stale_socket_is_replaced(tmp_path, start):
    daemon = start()
    daemon.stop(signal.SIGKILL)
    assert os.path.exists(daemon.socket)
    process = subprocess.Popen([DAEMON, "--socket", daemon.socket])
    eventually(lambda: _answers(daemon.socket))
    process.terminate()
    assert process.wait(10) == 0


def _answers(path: str) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(path)
        except OSError:
            return False
    return True


def test_tcp_needs_the_token(start):
    daemon = start("--listen", "127.0.0.1:0")
    token_file = os.path.join(os.path.dirname(daemon.socket), "token")
    assert stat.S_IMODE(os.stat(token_file).st_mode) == 0o600
    token = open(token_file).read()
    assert len(token) == 64
    with grpc.insecure_channel(daemon.ready["listen"][0]) as channel:
        stub = service_pb2_grpc.RendererStub(channel)
        for metadata in ([], [("authorization", "Bearer " + "0" * 64)], [("authorization", token)]):
            with pytest.raises(grpc.RpcError) as error:
                stub.GetServerInfo(service.GetServerInfoRequest(), metadata=metadata, timeout=5)
            assert error.value.code() == grpc.StatusCode.UNAUTHENTICATED
        bearer = [("authorization", "Bearer " + token)]
        info = stub.GetServerInfo(service.GetServerInfoRequest(), metadata=bearer, timeout=5)
        assert info.version
        opened = stub.OpenSession(service.OpenSessionRequest(), metadata=bearer, timeout=5)
        session = [*bearer, ("heliograph-session", str(opened.session))]
        assert stub.CreateScene(service.CreateSceneRequest(), metadata=session, timeout=5).scene
    daemon.stop()
    assert token not in daemon.process.stderr.read()


def test_a_private_daemon_ends_with_its_owner_and_leaves_no_files(start):
    owner = subprocess.Popen(["sleep", "100"])
    pidfd = os.pidfd_open(owner.pid)
    daemon = start("--private", "--owner-pidfd", str(pidfd), pass_fds=(pidfd,))
    client = Client(daemon)
    client.create("x")
    owner.kill()
    owner.wait()
    assert daemon.process.wait(5) == 0
    assert not os.path.exists(os.path.dirname(daemon.socket))
    client.close()
    os.mkdir(os.path.dirname(daemon.socket))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_an_idle_daemon_with_0(start, number):
    daemon = start()
    client = Client(daemon)
    begin = time.monotonic()
    assert daemon.stop(number) == 0
    assert time.monotonic() - begin < 2
    client.close()


def test_a_flood_of_connections_leaves_the_daemon_answering(start):
    daemon = start(under=("prlimit", "--nofile=128"))
    flood = []
    for _ in range(400):
        connection = socket.socket(socket.AF_UNIX)
        connection.setblocking(False)
        try:
            connection.connect(daemon.socket)
        except BlockingIOError:
            pass
        flood.append(connection)
    time.sleep(0.3)
    for connection in flood:
        connection.close()
    begin = time.monotonic()
    client = Client(daemon)
    assert client.create()
    assert time.monotonic() - begin < 2
    client.close()


def test_connections_are_counted_down_again(start):
    daemon = start(limits={"connections": 4})
    for _ in range(20):
        client = Client(daemon)
        client.create()
        client.close()


def test_one_process_may_not_take_all_connections(start):
    daemon = start(limits={"connections_per_peer": 2})
    clients = [Client(daemon), Client(daemon)]
    with socket.socket(socket.AF_UNIX) as third:
        third.connect(daemon.socket)
        third.settimeout(5)
        assert third.recv(1) == b""
    for client in clients:
        client.close()


def tcp_daemon(start, **limits):
    """A daemon that listens at loopback too, and its port."""
    daemon = start("--listen", "127.0.0.1:0", limits=limits)
    return daemon, int(daemon.ready["listen"][0].split(":")[1])


def knock(port, source="127.0.0.1"):
    """A connection that sends nothing, not even a header."""
    return socket.create_connection(("127.0.0.1", port), timeout=5, source_address=(source, 0))


def is_kept(connection):
    connection.settimeout(0.5)
    try:
        return connection.recv(1) != b""
    except TimeoutError:
        return True
    except ConnectionResetError:
        return False


def test_one_address_may_not_take_all_connections(start):
    _, port = tcp_daemon(start, connections_per_peer=2)
    with contextlib.ExitStack() as stack:
        opened = [stack.enter_context(knock(port)) for _ in range(3)]
        assert [is_kept(each) for each in opened] == [True, True, False]
        assert is_kept(stack.enter_context(knock(port, "127.0.0.2")))
        opened[0].close()
        eventually(lambda: is_kept(stack.enter_context(knock(port))))


def test_strangers_leave_the_unix_socket_its_share(start):
    daemon, port = tcp_daemon(start, connections=8)
    with contextlib.ExitStack() as stack:
        flood = [stack.enter_context(knock(port)) for _ in range(16)]
        assert sum(map(is_kept, flood)) == 6
        client = Client(daemon)
        assert client.create()
        client.close()


def health(channel: grpc.Channel, name: str) -> int:
    """grpc.health.v1.Health/Check by hand: its request and reply have one field each."""
    check = channel.unary_unary("/grpc.health.v1.Health/Check")
    request = b"\x0a" + bytes([len(name)]) + name.encode() if name else b""
    reply = check(request, timeout=5, wait_for_ready=True)
    return reply[1] if reply else 0


SERVING, NOT_SERVING = 1, 2


def test_health_is_live_at_once_and_ready_after_a_pixel(start):
    daemon = start()
    client = Client(daemon)
    assert health(client.channel, "") == SERVING
    eventually(lambda: health(client.channel, "heliograph.v1.Renderer") == SERVING)
    assert client.call("GetServerInfo").ready
    client.close()
