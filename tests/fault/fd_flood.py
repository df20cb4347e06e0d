"""S2: four times as many connections as there may be descriptors; once they are closed, a new call
succeeds within 2 s."""

import contextlib
import resource
import socket
import time

import common
import heliograph as hg
from served import few_descriptors, served

DESCRIPTORS = 256


def flood(daemon, kind):
    """Connections that send nothing."""
    found = []
    for _ in range(4 * DESCRIPTORS):
        if kind == "tcp":
            connection = socket.socket()
            host, port = daemon.tcp.rsplit(":", 1)
            address = (host, int(port))
        else:
            connection = socket.socket(socket.AF_UNIX)
            address = daemon.path
        connection.setblocking(False)
        with contextlib.suppress(BlockingIOError, ConnectionError):
            connection.connect(address)
        found.append(connection)
    return found


def main():
    resource.setrlimit(resource.RLIMIT_NOFILE, (8192, 8192))
    with (
        common.Report("S2 floods of connections") as report,
        served("--listen", "127.0.0.1:0", under=few_descriptors(DESCRIPTORS)) as daemon,
    ):
        with hg.connect(daemon.socket) as client:
            common.stage(client)
        baseline = daemon.descriptors()
        slowest, most = 0.0, 0
        for trial in range(common.size(20, 2)):
            connections = flood(daemon, ("unix", "tcp")[trial % 2])
            time.sleep(0.3)
            most = max(most, daemon.descriptors())
            for connection in connections:
                connection.close()
            start = time.perf_counter()
            with hg.connect(daemon.socket) as client:
                client.create_scene().delete()
            slowest = max(slowest, time.perf_counter() - start)
        report.figure("descriptors in use at most", most, DESCRIPTORS, slack=False)
        report.figure("after the flood: a call answered after", slowest, 2, "s", slack=False)
        common.seconds_until(lambda: daemon.descriptors() <= baseline + 3)
        report.figure("descriptors kept", max(0, daemon.descriptors() - baseline), 3, slack=False)


if __name__ == "__main__":
    main()
