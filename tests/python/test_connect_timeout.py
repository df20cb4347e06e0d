"""connect(timeout=) is the time that connecting takes at most, in each way that it can fail."""

import asyncio
import contextlib
import socket
import stat
import threading
import time

import fake
import heliograph as hg
import pytest
from heliograph import aio

SECONDS = 1.0
SLACK = 6.0  # of a loaded machine; what takes no notice of timeout= takes 10 s or more

# Programs that do not listen, in place of a private daemon. "$0.pid": of what it started.
STUCK = {
    "sleeps": "echo $$ > $0.pid; exec sleep 60",
    "ignores signals": "trap '' TERM; echo $$ > $0.pid; echo waiting; sleep 60; sleep 60",
    "leaves a child": "sleep 60 & echo $! > $0.pid; wait",
    "closes its end": "echo $$ > $0.pid; exec 2>&1; for fd in $(ls /proc/$$/fd); do "
    '[ $fd -gt 2 ] && [ $fd -lt 200 ] && eval "exec $fd>&-"; done; exec sleep 60',
    "names a silent socket": "echo $$ > $0.pid; "
    'echo \'{"socket": "SILENT"}\' > /proc/self/fd/$READY; exec sleep 60',
}


@contextlib.contextmanager
def silent(folder):
    """A socket that takes connections and sends nothing."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(f"{folder}/s.sock.fd.sock")
        listener.listen()
        yield f"{folder}/s.sock"


def script(path, text):
    find = 'while [ "$1" != --ready-fd ]; do shift; done; READY=$2\n'
    path.write_text("#!/bin/bash\n" + find + text + "\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def is_there(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def connect_async(*args, **options):
    return asyncio.run(aio.connect(*args, **options))


def refused(connect, *args):
    """The message of a connect that fails in time."""
    start = time.monotonic()
    with pytest.raises(hg.Unavailable) as error:
        connect(*args, timeout=SECONDS)
    assert time.monotonic() - start < SECONDS + SLACK
    return str(error.value)


@pytest.mark.parametrize("connect", [hg.connect, connect_async])
@pytest.mark.parametrize("how", STUCK)
def test_a_private_daemon_that_never_gets_ready(tmp_path, monkeypatch, connect, how):
    with silent(tmp_path) as path:
        program = script(tmp_path / "d", STUCK[how].replace("SILENT", path))
        monkeypatch.setenv("HELIOGRAPHD", program)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        text = refused(connect)
    if how != "closes its end":
        assert "within 1 s" in text and "timeout=" in text
    pid = int((tmp_path / "d.pid").read_text())
    deadline = time.monotonic() + 10
    while is_there(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_there(pid)
    assert not list(tmp_path.glob("heliograph-*"))


@pytest.mark.parametrize("connect", [hg.connect, connect_async])
def test_a_socket_that_says_nothing(tmp_path, connect):
    with silent(tmp_path) as path:
        text = refused(connect, f"unix://{path}")
    assert "no answer within 1 s" in text and "timeout=" in text


@pytest.mark.parametrize("connect", [hg.connect, connect_async])
def test_a_port_that_says_nothing(connect):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        text = refused(connect, f"127.0.0.1:{listener.getsockname()[1]}")
    assert "no answer within 1 s" in text and "timeout=" in text


@pytest.mark.parametrize("connect", [hg.connect, connect_async])
def test_nobody_listens_at_a_port(connect):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        assert "no connection to the daemon" in refused(connect, address)


def test_a_ticket_but_no_session(tmp_path):
    """The local channel answers, the gRPC socket does not."""
    with fake.running(tmp_path) as daemon:
        daemon._server.stop(0).wait()
        refused(hg.connect, daemon.address)


def test_a_daemon_that_stops_within_the_handshake(tmp_path, monkeypatch):
    held = threading.Event()
    monkeypatch.setattr(fake.FakeDaemon, "OpenSession", lambda *_: held.wait(5))
    with fake.running(tmp_path) as daemon:
        assert "no answer within 1 s" in refused(hg.connect, daemon.address)
        held.set()


@pytest.mark.parametrize("timeout", [0, -1, float("nan"), float("inf"), "2", True])
def test_a_timeout_is_seconds(timeout):
    with pytest.raises(hg.InvalidArgument, match="timeout: seconds, above 0"):
        hg.connect("unix:///nowhere", timeout=timeout)


def test_a_longer_timeout_is_no_wait(tmp_path):
    with fake.running(tmp_path) as daemon:
        start = time.monotonic()
        hg.connect(daemon.address, timeout=30).close()
        assert time.monotonic() - start < 5
