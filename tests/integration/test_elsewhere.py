"""The Python client works over TCP, with TLS and without, where Linux's modules and calls are
missing, as on Windows and macOS."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).parent
sys.path.append(str(HERE.parent / "fault"))
import served  # noqa: E402

DAEMON = os.environ.get("HELIOGRAPHD", HERE.parents[1] / "build/cpu/bin/heliographd")


@pytest.fixture
def start(tmp_path):
    """start(flags...) -> (address, token) of a daemon over TCP."""
    running = []

    def make(*flags):
        read, write = os.pipe()
        files = ["--socket", tmp_path / "socket", "--token-file", tmp_path / "token"]
        running.append(
            subprocess.Popen(
                [DAEMON, *files, "--ready-fd", str(write), "--listen", "127.0.0.1:0", *flags],
                pass_fds=(write,),
            )
        )
        os.close(write)
        with os.fdopen(read) as ready:
            address = json.loads(ready.readline())["listen"][0]
        return address, (tmp_path / "token").read_text().strip()

    yield make
    for process in running:
        process.terminate()
        assert process.wait(10) == 0


def run(*words):
    done = subprocess.run(
        [sys.executable, HERE / "elsewhere.py", *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.endswith("fine\n"), done.stdout


def test_over_loopback_tcp(start):
    run(*start())


def test_over_tls(start, tmp_path):
    authority = served.Authority(tmp_path)
    cert, key = authority.sign("server")
    run(*start("--tls-cert", cert, "--tls-key", key), str(authority.pem))
