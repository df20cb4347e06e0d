"""R15: steps of the wall clock by ten years, forwards and backwards, change nothing: sessions and
their grace time, deadlines, the order of edits, keepalive and readiness go by the steady clock.

The clock is skewed for the daemon alone, by a preloaded library (skewed_clock.cpp).
"""

import mmap
import os
import pathlib
import struct
import tempfile
import threading
import time

import common
import heliograph as hg
from health import Health
from heliograph._wire.launch import find_program
from served import served

YEARS = int(10 * 365.25 * 86400)
GRACE = 1.0


class Clock:
    """Offset of the daemon's wall clock."""

    def __init__(self, folder):
        self.path = f"{folder}/offset"
        pathlib.Path(self.path).write_bytes(bytes(8))
        with open(self.path, "r+b") as file:
            self._page = mmap.mmap(file.fileno(), 8)
        library = pathlib.Path(find_program()).with_name("skewed_clock.so")
        self.environment = dict(os.environ, LD_PRELOAD=str(library), SKEWED_CLOCK=self.path)

    def set(self, seconds):
        self._page[:] = struct.pack("q", seconds)


def main():
    flags = ("--grace", str(GRACE), "--listen", "127.0.0.1:0", "--log-level", "info", "--log-json")
    with (
        common.Report("R15 clock") as report,
        tempfile.TemporaryDirectory(prefix="hg-") as folder,
    ):
        clock = Clock(folder)
        with (
            served(*flags, env=clock.environment) as daemon,
            hg.connect(daemon.socket) as client,
            hg.connect(daemon.tcp, token=daemon.token()) as remote,
        ):
            watch = Health(daemon.socket)
            watch.wait(True)
            changes = watch.watch()
            scene, far = common.stage(client), common.stage(remote)
            sessions = {client.connection.link.session, remote.connection.link.session}
            late, graces, edits = [], [], 0
            for step in (YEARS, -YEARS, 0, -YEARS, YEARS, 0) * common.size(10, 1):
                graces.append(abandon(daemon, client, lambda s=step: clock.set(s)) - GRACE)
                late.append(deadline(scene, lambda s=step: clock.set(-s)))
                edits += edit(scene, far)
            time.sleep(common.size(40, 0))  # longer than keepalive's 20 s and 5 s
            edits += edit(scene, far)
            now = {client.connection.link.session, remote.connection.link.session}
            worst = 1e3 * max(map(abs, graces))
            report.figure("grace time too long or short: worst", worst, 150, "ms")
            report.figure("error after the deadline: worst", 1e3 * max(late), 50, "ms")
            report.figure("edits lost or out of order", edits, 0, slack=False)
            report.figure("sessions lost", len(sessions - now), 0, slack=False)
            report.figure("times it was not ready", len(changes.seen) - 1, 0, slack=False)
            report.figure("years the log did not see", 2 - years(daemon.log()), 0, slack=False)


def years(log):
    """How many kinds of wrong year a log saw, whose times are the wall clock's: the positive
    control."""
    here = time.gmtime().tm_year
    return sum(f'"time":"{here + years}' in log for years in (-10, 10))


def abandon(daemon, client, step):
    """Seconds that a session lives after its client is gone, the clock stepping meanwhile."""
    client_gone = hg.connect(daemon.socket)
    with client_gone.create_scene().edit() as edits:
        edits.entity("leftover")
    before = common.used(client, "tenant_entities")
    client_gone.connection.link._local_channel.close()
    start = time.perf_counter()
    time.sleep(GRACE / 2)
    step()
    common.seconds_until(lambda: common.used(client, "tenant_entities") < before)
    return time.perf_counter() - start


def deadline(scene, step):
    """Seconds from the deadline to its error."""
    timer = threading.Timer(0.2, step)
    timer.start()
    start = time.perf_counter()
    try:
        scene.render("cam", spp=1 << 20, timeout=0.4)
    except hg.DeadlineExceeded:
        return time.perf_counter() - start - 0.4
    finally:
        timer.join()


def edit(*scenes):
    """How many of some edits are not where they belong."""
    wrong = 0
    for scene in scenes:
        first = scene.revision
        for _ in range(20):
            with scene.edit() as edits:
                edits.entity("ball", transform=hg.Pose((0, 0, 0.5)))
        wrong += abs(scene.revision - first - 20)
    return wrong


if __name__ == "__main__":
    main()
