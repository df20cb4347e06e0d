"""Descriptors that a local client passes, and that take long to be closed (a socket with SO_LINGER
and unsent bytes; one in the queue of another; many in one packet), hold up nobody: liveness, calls,
scrapes and SIGTERM are as without them."""

import array
import contextlib
import socket
import struct
import subprocess
import time
import urllib.request

import common
import heliograph as hg
import served

TIMES = common.size(8, 1)
LINGER = common.size(30, 5)  # seconds
SOON = common.size(1, 4)  # on a machine that others share


class Stuck:
    """A connection whose close() would wait for LINGER seconds."""

    def __init__(self):
        self.listener = socket.socket()
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.listener.bind(("127.0.0.1", 0))
        self.listener.listen(1)
        self.socket = socket.create_connection(self.listener.getsockname())
        self.peer, _ = self.listener.accept()
        self.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                self.socket.send(bytes(65536))
        linger = struct.pack("ii", 1, LINGER)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)


def line(path):
    """A local channel without a session."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    connection.connect(path + ".fd.sock")
    connection.recv(64)
    return connection


def word(connection, descriptors):
    rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", descriptors))
    connection.sendmsg([struct.pack("=QQ", 0, 1)], [rights])


def one(path, kept):
    """A lingering socket in a packet."""
    stuck, connection = Stuck(), line(path)
    word(connection, [stuck.socket.fileno()])
    stuck.socket.close()
    kept += [stuck, connection]


def many(path, kept):
    """A packet with more descriptors than anybody expects."""
    stuck, connection = [Stuck() for _ in range(40)], line(path)
    word(connection, [each.socket.fileno() for each in stuck])
    for each in stuck:
        each.socket.close()
    kept += [*stuck, connection]


def nested(path, kept):
    """The lingering socket waits in the queue of the one that is passed."""
    stuck, connection = Stuck(), line(path)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    word(ours, [stuck.socket.fileno()])
    stuck.socket.close()
    word(connection, [theirs.fileno()])
    theirs.close()
    kept += [stuck, connection, ours]


def unread(path, kept):
    """The connection ends before anybody read the packet."""
    for _ in range(4):
        stuck, connection = Stuck(), socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        connection.connect(path + ".fd.sock")
        word(connection, [stuck.socket.fileno()])
        stuck.socket.close()
        connection.close()
        kept.append(stuck)


def to_grpc(path, kept):
    """Beside bytes on the socket of gRPC, which a kernel before Linux 6.16 lets through."""
    stuck, connection = Stuck(), socket.socket(socket.AF_UNIX)
    connection.connect(path)
    try:
        socket.send_fds(connection, [b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"], [stuck.socket.fileno()])
    except PermissionError:  # then closing it is ours
        stuck.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))
    stuck.socket.close()
    kept += [stuck, connection]


def slowest(daemon, client):
    """Seconds of the slowest of a probe, a call, a scrape and a new client."""
    start, took = time.perf_counter(), []

    def lap():
        nonlocal start
        took.append(time.perf_counter() - start)
        start = time.perf_counter()

    subprocess.run([served.DAEMON, "--socket", daemon.path, "--probe", "live"], check=True)
    lap()
    client.info()
    lap()
    with urllib.request.urlopen(f"http://{daemon.metrics}/metrics", timeout=10) as page:
        page.read()
    lap()
    with hg.connect(daemon.socket):
        lap()
    return max(took)


def main():
    with common.Report("descriptors that take long to be closed") as report:
        with (
            served.served("--metrics", "127.0.0.1:0") as daemon,
            hg.connect(daemon.socket) as client,
        ):
            common.stage(client)
            before, kept = daemon.descriptors(), []
            for attack in (one, many, nested, unread, to_grpc):
                for _ in range(TIMES):
                    attack(daemon.path, kept)
                worst = max(slowest(daemon, client) for _ in range(3))
                report.figure(
                    f"slowest answer beside `{attack.__name__}`", worst, SOON, "s", slack=False
                )
            lines = sum(isinstance(each, socket.socket) for each in kept)
            gone = lambda: daemon.descriptors() <= before + 4 * lines + 4  # noqa: E731
            common.seconds_until(gone, LINGER * (TIMES + 1))  # nested ones linger one by one
            start = time.perf_counter()
            code = daemon.stop()
            report.figure("SIGTERM ends it after", time.perf_counter() - start, 5, "s")
            report.figure("exit code", code, 0, slack=False)


if __name__ == "__main__":
    main()
