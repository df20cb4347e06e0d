"""S1: bytes that are no gRPC, on every port: nothing crashes, nothing is kept."""

import contextlib
import random
import socket
import time

import common
import heliograph as hg
from served import served

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
HELLO = bytes.fromhex("16030100f8010000f40303") + bytes(240)  # of TLS, by the length


def random_bytes():
    return random.randbytes(random.randrange(1, 4000))


def http1():
    return random.choice(
        [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"POST /x HTTP/1.1\r\nContent-Length: 9\r\n\r\n123"]
    )


def random_frames():
    """A good preface, then frames with lengths that fit and contents that do not."""
    data = PREFACE
    for _ in range(random.randrange(1, 20)):
        body = random.randbytes(random.randrange(0, 200))
        head = len(body).to_bytes(3, "big") + bytes([random.randrange(12), random.randrange(256)])
        data += head + random.randrange(1 << 32).to_bytes(4, "big") + body
    return data


def half_a_preface():
    return PREFACE[: random.randrange(len(PREFACE))]


NOISE = (random_bytes, http1, lambda: HELLO, random_frames, half_a_preface)


def ports(daemon):
    """A function that connects, for each."""

    def tcp(address):
        host, port = address.rsplit(":", 1)
        return lambda: socket.create_connection((host, int(port)), timeout=5)

    def unix(path, kind):
        def connect():
            connection = socket.socket(socket.AF_UNIX, kind)
            connection.settimeout(5)
            connection.connect(path)
            return connection

        return connect

    return (
        unix(daemon.path, socket.SOCK_STREAM),
        unix(daemon.path + ".fd.sock", socket.SOCK_SEQPACKET),
        tcp(daemon.tcp),
        tcp(daemon.metrics),
    )


def disturb(connect):
    with contextlib.suppress(OSError), connect() as connection:
        connection.sendall(random.choice(NOISE)())
        if random.random() < 0.2:
            connection.settimeout(0.02)
            connection.recv(1000)


def main():
    random.seed(1)
    with (
        common.Report("S1 noise on the ports") as report,
        served("--listen", "127.0.0.1:0", "--metrics", "127.0.0.1:0") as daemon,
        hg.connect(daemon.socket) as client,
    ):
        scene = common.stage(client)
        before = scene.render("cam", spp=4)
        connects = ports(daemon)
        for connect in connects * 20:
            disturb(connect)
        time.sleep(0.5)
        descriptors, memory = daemon.descriptors(), common.resident(daemon.pid)
        for i in range(common.size(10_000, 800)):
            disturb(connects[i % len(connects)])
        start = time.perf_counter()
        after = scene.render("cam", spp=4)
        report.figure("next call answered after", time.perf_counter() - start, 2, "s")
        common.seconds_until(lambda: daemon.descriptors() <= descriptors + 2)
        grown = (common.resident(daemon.pid) - memory) / 2**20
        report.figure("crashes", int(daemon.process.poll() is not None), 0, slack=False)
        kept = max(0, daemon.descriptors() - descriptors)
        report.figure("descriptors kept", kept, 2, slack=False)
        report.figure("memory kept", grown, 20, "MiB", slack=False)
        differ = (before["beauty"] != after["beauty"]).any()
        report.figure("images that differ", int(differ), 0, slack=False)


if __name__ == "__main__":
    main()
