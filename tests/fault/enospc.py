"""The state directory's disk is full: durable edits are refused, nothing else is; they go on when
there is room again, without a restart, and nothing acknowledged is lost."""

import contextlib
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import heliograph as hg
import numpy as np
from common import Report, seconds_until, size
from health import DURABLE, Health
from heliograph.errors import ResourceExhausted, Unavailable
from served import Served

MEBIBYTES = size(64, 8)


@contextlib.contextmanager
def small_disk(folder):
    """A folder on a file system of its own."""
    path = pathlib.Path(folder) / "disk"
    path.mkdir()
    options = f"size={MEBIBYTES}m"
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", path], capture_output=True
    )
    if mounted.returncode != 0:
        print("enospc: a tmpfs cannot be mounted here:", mounted.stderr.decode().strip())
        sys.exit(0 if os.geteuid() != 0 else 1)
    try:
        yield path
    finally:
        subprocess.run(["umount", path], check=True)


def count(scene, number, vertices=0):
    """One edit, with 12 bytes of array a vertex."""
    with scene.edit() as edit:
        edit.entity("counter", transform=hg.Pose((number, 0, 0)))
        if vertices:
            positions = np.full((vertices, 3), number, dtype="<f4")
            edit.mesh(f"mesh {number}", positions=positions, indices=[[0, 1, 2]])


def count_until_refused(scene, number, vertices):
    """The last number that was acknowledged."""
    for each in range(number + 1, number + 10_000):
        try:
            count(scene, each, vertices)
        except (ResourceExhausted, Unavailable) as error:
            print(f"  {each - number - 1} edits of {vertices} vertices, then", end=" ")
            print(f"{type(error).__name__}: {error}")
            return each - 1
    raise AssertionError("the disk never fills")


def fill(path):
    """Takes all that is left of the disk."""
    with open(path, "wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(4096)):
            pass
    return path


def main():
    with contextlib.ExitStack() as stack:
        report = stack.enter_context(Report("disk full"))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        disk = stack.enter_context(small_disk(folder))
        state = disk / "state"
        daemon = Served(folder, "--state-dir", state)
        client = hg.connect(daemon.socket)
        scene = client.create_scene("room", lifetime="disk")
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(MEBIBYTES << 19))
        acknowledged = count_until_refused(scene, 0, vertices=25_000)
        rest = fill(disk / "rest")
        acknowledged = count_until_refused(scene, acknowledged, vertices=0)
        health = Health(client)
        seconds = seconds_until(lambda: not health.check(DURABLE))
        report.figure("until health says read-only", seconds, 1, "s")
        info = client.info()
        report.figure("not said by name", info.journal != info.JOURNAL_READ_ONLY, 0)
        report.figure("without a reason", "disk" not in info.journal_reason, 0)
        report.figure("not ready", not health.check(), 0)
        revision = scene.revision
        report.figure("revisions beyond what was acknowledged", revision - acknowledged, 0)
        with client.create_scene() as plain, plain.edit() as edit:
            edit.entity("cam", camera=hg.Camera.from_fov(50, 16, 16, degrees=True))
        start = time.perf_counter()
        with client.create_scene() as plain:
            with plain.edit() as edit:
                edit.entity("cam", camera=hg.Camera.from_fov(50, 16, 16, degrees=True))
            plain.render("cam", planes=["depth"], labels=False)
        report.figure("a frame meanwhile", time.perf_counter() - start, 5, "s")
        ballast.unlink()
        rest.unlink()
        last = acknowledged + 1

        def writes_again():
            try:
                count(scene, last, vertices=25_000)
            except (ResourceExhausted, Unavailable):
                time.sleep(0.1)
                return False
            return True

        report.figure("until edits go on", seconds_until(writes_again), 5, "s")
        seconds = seconds_until(lambda: health.check(DURABLE))
        report.figure("until health says so", seconds, 1, "s")
        info = client.info()
        report.figure("journal is not writing", info.journal != info.JOURNAL_WRITING, 0)
        daemon.kill()
        client.connection.close()
        daemon = Served(folder, "--state-dir", state)
        with hg.connect(daemon.socket) as client:
            x = client.open_scene("room").transforms(["counter"])[0, 0, 3]
            report.figure("edits lost", last - x, 0)
        daemon.stop()


if __name__ == "__main__":
    main()
