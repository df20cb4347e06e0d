"""The log holds up nobody and cannot be forged: a full pipe that nobody reads, names with control,
C1 and bidirectional characters, long ones."""

import contextlib
import json
import os
import subprocess
import time
import unicodedata
import urllib.request

import common
import heliograph as hg
import served

PLAIN = "a\n2026-01-01 error forged\x1b[31m\x7f\u009b31m\u202e\u2028\u0085\u2066\u200b"
BIDI = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}


def open_session(daemon, name):
    """The status code of an OpenSession with that client's name."""
    request = served.service.OpenSessionRequest(client=name)
    with served.channel_of(daemon.socket) as channel:
        call = channel.unary_unary(
            "/heliograph.v1.Renderer/OpenSession",
            request_serializer=served.service.OpenSessionRequest.SerializeToString,
            response_deserializer=served.service.OpenSessionReply.FromString,
        )
        try:
            call(request, timeout=10)
        except served.grpc.RpcError as error:
            return error.code().name
    return "OK"


def harmful(text):
    """Characters that change what a terminal or an editor shows."""
    return sum(
        c != "\n"
        and (
            unicodedata.category(c) in ("Cc", "Cf", "Zl", "Zp")
            or unicodedata.bidirectional(c) in BIDI
        )
        for c in text
    )


def forge(report):
    """Checks a hostile name in both kinds of log."""
    for flags in ((), ("--log-json",)):
        with served.served("--log-level", "info", *flags) as daemon:
            refused = open_session(daemon, "x" * (15 << 20) if not flags else "x" * 257)
            report.figure(f"too long a name {flags}: let in", int(refused != "INVALID_ARGUMENT"), 0)
            open_session(daemon, PLAIN)
            common.seconds_until(lambda: "session opened" in daemon.log())  # noqa: B023
            log = daemon.log()
        lines = log.splitlines()
        report.figure("characters that are not escaped", harmful(log), 0, slack=False)
        forged = sum(line.startswith("2026-01-01 error") for line in lines)
        report.figure("forged lines", forged, 0, slack=False)
        report.figure("longest line", max(map(len, lines)), 8192, "bytes", slack=False)
        if flags:
            for line in lines:
                json.loads(line)


def refused_call(client):
    with contextlib.suppress(hg.NotFound):
        client.open_scene("nope")


def dropped(daemon):
    with urllib.request.urlopen(f"http://{daemon.metrics}/metrics", timeout=5) as page:
        for line in page.read().decode().splitlines():
            if line.startswith("heliograph_log_dropped_lines_total "):
                return float(line.split()[1])
    raise LookupError("no such metric")


class Unread(served.Served):
    """Its stderr is a pipe that nobody reads until drain()."""

    def __init__(self, folder, *flags):
        self.read, write = os.pipe()
        os.set_blocking(self.read, False)
        super().__init__(folder, *flags, stderr=write)
        os.close(write)

    def drain(self):
        """Text written until now."""
        text = b""
        with contextlib.suppress(BlockingIOError):
            while piece := os.read(self.read, 1 << 20):
                text += piece
        return text.decode()


def stop_reading(report):
    """Calls, probes and the end beside a full pipe."""
    flags = ("--log-level", "info", "--metrics", "127.0.0.1:0", "--limit", "log_bytes=65536")
    with served.folder() as folder:
        daemon = Unread(folder, *flags)
        with hg.connect(daemon.socket) as client:
            slowest = 0.0
            for _ in range(common.size(10_000, 2_500)):
                start = time.perf_counter()
                refused_call(client)
                slowest = max(slowest, time.perf_counter() - start)
            report.figure("slowest call beside a full pipe", slowest, 0.5, "s")
            probe = [served.DAEMON, "--socket", daemon.path, "--probe", "live"]
            code = subprocess.run(probe, check=False).returncode
            report.figure("exit code of --probe live", code, 0, slack=False)
            dropped_lines = dropped(daemon)
            report.figure("dropped lines are counted", int(dropped_lines == 0), 0, slack=False)
            text = ""

            def is_reported():
                nonlocal text
                text += daemon.drain()
                return "log lines were dropped" in text

            took = common.seconds_until(is_reported)
            report.figure("told what was dropped after", took, 2, "s")
            for _ in range(2000):
                refused_call(client)
        start = time.perf_counter()
        report.figure("exit code", daemon.stop(), 0, slack=False)
        report.figure("SIGTERM ends it after", time.perf_counter() - start, 5, "s")


def main():
    with common.Report("the log") as report:
        forge(report)
        stop_reading(report)


if __name__ == "__main__":
    main()
