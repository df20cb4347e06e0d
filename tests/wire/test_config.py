"""--config: the settings file, what goes before it, and what it refuses."""

import json
import os
import subprocess

import pytest
from conftest import DAEMON, Client


def write(folder, text: str) -> str:
    path = os.path.join(folder, "heliograph.toml")
    with open(path, "w") as file:
        file.write(text)
    return path


def refusal(path: str, *flags: str) -> str:
    result = subprocess.run(
        [DAEMON, "--config", path, *flags], capture_output=True, text=True, timeout=20
    )
    assert result.returncode == 64, result.stderr
    return result.stderr


def test_a_file_sets_flags_and_limits(start, tmp_path):
    path = write(
        tmp_path,
        """
# what this daemon is for
threads = 1
grace = 0.25
log-level = "info"
log-json = true
listen = ["127.0.0.1:0", "127.0.0.1:0"]

[limits]
jobs = 7
scenes = 9
""",
    )
    daemon = start("--config", path)
    client = Client(daemon)
    info = client.call("GetServerInfo")
    assert info.threads == 1
    assert (info.limits["jobs"], info.limits["scenes"]) == (7, 9)
    assert client.opened.grace_seconds == 0.25
    assert len(daemon.ready["listen"]) == 2
    client.close()
    daemon.stop()
    lines = daemon.process.stderr.read().splitlines()
    assert lines and all(json.loads(line)["event"] for line in lines)


def test_flags_go_before_the_file(start, tmp_path):
    path = write(tmp_path, "threads = 1\n[limits]\njobs = 7\nscenes = 9\n")
    daemon = start("--config", path, "--threads", "2", limits={"jobs": 8})
    client = Client(daemon)
    info = client.call("GetServerInfo")
    assert info.threads == 2
    assert (info.limits["jobs"], info.limits["scenes"]) == (8, 9)
    client.close()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("treads = 1", "'treads'"),
        ("[limits]\njbos = 1", "'jbos'"),
        ("[limts]\njobs = 1", "'limts.jobs'"),
        ("jobs = 1", "'jobs'"),
        ("[limits]\njobs = 0", "jobs needs a number above 0, not '0'"),
        ('[limits]\njobs = "many"', "jobs needs a number above 0, not 'many'"),
        ('threads = "many"', "threads"),
        ("threads = 1\nthreads = 2", "--threads"),
        ("threads = 1\ngrace = 1\nthreads = 2", "'threads' is set twice"),
        ("[limits]\njobs = 1\njobs = 2", "'limits.jobs' is set twice"),
        ('backend = "nope"', "--backend"),
        ("grace = -1", "--grace"),
        ('limit = "jobs=1"', "'limit'"),
        ('probe = "live"', "'probe'"),
        ("this is no toml", "this is no toml"),
    ],
)
def test_a_wrong_file_is_refused_and_the_key_named(tmp_path, text, named):
    assert named in refusal(write(tmp_path, text))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    path = str(tmp_path / "none.toml")
    assert path in refusal(path)


def test_every_flag_and_limit_can_stand_in_the_file(tmp_path):
    """--help's names, each with a value of its kind; the last line is wrong, so that it ends."""
    help_text = subprocess.run(
        [DAEMON, "--help"], capture_output=True, text=True, check=True
    ).stdout
    flags, limits = help_text.split("Limits (--limit NAME=VALUE):")
    values = {
        "threads": "1",
        "devices": "1",
        "spread-samples": "1",
        "device-memory": "1",
        "grace": "1",
        "drain": "1",
        "owner-pidfd": "-1",
        "ready-fd": "-1",
        "listen": '["127.0.0.1:0"]',
        "log-level": '"error"',
        "backend": '"embree"',
        "decode-without": '["landlock"]',
        "socket-group": '"0"',
        "log-json": "true",
        "reflection": "true",
        "private": "false",
        "insecure-i-know": "false",
        "tenants": '""',
        "tls-client-ca": '""',
    }
    lines = []
    for line in flags.splitlines():
        name = line.strip().split(" ")[0].split(",")[-1].removeprefix("--")
        if line.strip().startswith("--") and name not in ("version", "config", "limit", "probe"):
            lines.append(f"{name} = {values.get(name, chr(34) + 'x' + chr(34))}")
    assert len(lines) > 15
    lines.append("[limits]")
    for line in limits.splitlines():
        if "[" in line:
            name = line.split()[0]
            lines.append(f"{name} = {line.rsplit('[', 1)[1].rstrip(']')}")
    assert len(lines) > 55
    assert "'the_end'" in refusal(write(tmp_path, "\n".join([*lines, "the_end = 1"])))
