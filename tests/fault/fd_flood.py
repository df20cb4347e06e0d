"""S2: four times as many connections as there may be descriptors; once they are closed, a new call
succeeds within 2 s."""

import contextlib
import resource
import socket
import time

import common
import heliograph as hg
from health import Served

DESCRIPTORS = 256


def flood(served, kind):
    """Connections that send nothing."""
    found = []
    for _ in range(4 * DESCRIPTORS):
        if kind == "tcp":
            connection = socket.socket()
            host, port = served.ready["listen"][0].rsplit(":", 1)
            address = (host, int(port))
        else:
            connection = socket.socket(socket.AF_UNIX)
            address = served.socket
        connection.setblocking(False)
        with contextlib.suppress(BlockingIOError, ConnectionError):
            connection.connect(address)
        found.append(connection)
    return found


def main():
    def limit():
        resource.setrlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS))

    resource.setrlimit(resource.RLIMIT_NOFILE, (8192, 8192))
    with (
        common.Report("S2 floods of connections") as report,
        Served("--listen", "127.0.0.1:0", preexec_fn=limit) as served,
    ):
        with hg.connect(served.address) as client:
            common.stage(client)
        baseline = served.descriptors()
        slowest, most = 0.0, 0
        for trial in range(common.size(20, 2)):
            connections = flood(served, ("unix", "tcp")[trial % 2])
            time.sleep(0.3)
            most = max(most, served.descriptors())
            for connection in connections:
                connection.close()
            start = time.perf_counter()
            with hg.connect(served.address) as client:
                client.create_scene().delete()
            slowest = max(slowest, time.perf_counter() - start)
        report.figure("descriptors in use at most", most, DESCRIPTORS, slack=False)
        report.figure("after the flood: a call answered after", slowest, 2, "s", slack=False)
        common.seconds_until(lambda: served.descriptors() <= baseline + 3)
        report.figure("descriptors kept", max(0, served.descriptors() - baseline), 3, slack=False)


if __name__ == "__main__":
    main()
