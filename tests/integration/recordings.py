"""Recordings for tests: daemons that record, what became of each call, and the items of a file."""

import contextlib
import pathlib
import re
import subprocess
import sys

import heliograph as hg
import pytest
from google.protobuf.internal.encoder import _VarintBytes
from heliograph._wire._proto import recording_pb2 as pb

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests/fault"), str(ROOT / "scripts")]
import common  # noqa: E402
from heliograph_replay.reader import Recording  # noqa: E402
from heliograph_replay.replay import DIFFERS, NOT_PLAYED, SAME, replay  # noqa: E402
from served import Served  # noqa: E402

PLANES = ["beauty", "depth", "instance"]


@pytest.fixture
def recorded(tmp_path):
    """Starts a daemon that records; `.recording` is its file."""
    running = []

    def start(*flags):
        daemon = Served(tmp_path, "--record", tmp_path / "session.recording", *flags)
        daemon.recording = tmp_path / "session.recording"
        running.append(daemon)
        return daemon

    yield start
    for daemon in running:
        daemon.process.kill()
        daemon.process.wait(30)


def played(path, *flags):
    """Counts of calls at a private daemon, by verdict."""
    found = {SAME: [], DIFFERS: [], NOT_PLAYED: []}
    with hg.connect(arguments=flags) as client:
        for outcome in replay(Recording(path), client):
            found[outcome.verdict].append(f"{outcome.what}: {outcome.text}")
    return found


def methods(lines):
    """The methods of these calls."""
    return {re.match(r"call \d+ (\w+)", line)[1] for line in lines}


def furnish(scene):
    common.furnish(scene, 48, 48)


@contextlib.contextmanager
def shared_room(daemon):
    """A furnished scene, as the two sessions that share it see it."""
    with hg.connect(daemon.socket) as one, hg.connect(daemon.socket) as two:
        mine = one.create_scene("room", lifetime="daemon")
        furnish(mine)
        yield mine, two.open_scene("room")


def place(scene, x):
    with scene.edit() as edit:
        edit.entity("ball", transform=hg.Pose((x, 0, 0.5)))


def items_of(path):
    """The items of a recording."""
    data, at, items = path.read_bytes(), 0, []
    while at < len(data):
        size = shift = 0
        while True:
            byte = data[at]
            at, size, shift = at + 1, size | (byte & 0x7F) << shift, shift + 7
            if byte < 0x80:
                break
        items.append(pb.RecordItem.FromString(data[at : at + size]))
        at += size
    return items


def write_items(path, items):
    path.write_bytes(b"".join(_VarintBytes(i.ByteSize()) + i.SerializeToString() for i in items))


def replay_command(path, *arguments):
    command = [sys.executable, str(ROOT / "scripts/replay"), str(path), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture
def short(recorded):
    """The recording of a scene that is moved twice and rendered each time."""
    daemon = recorded()
    with hg.connect(daemon.socket) as client, client.create_scene("room") as scene:
        furnish(scene)
        for x in (0.1, 0.2):
            place(scene, x)
            scene.render("cam", planes=PLANES, spp=2)
    daemon.stop()
    return daemon.recording
