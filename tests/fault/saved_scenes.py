"""R14, the host's other half: a device that is lost for this process. The daemon saves what its
clients have and ends with 75 at once; the next one on the same state directory has the same scenes,
pictures and numbers of edits, and the clients go on. Nothing of it stays on the disk.

The faults are injected into heliographd-faulty (faulty_daemon.cpp), which is beside heliographd.
"""

import contextlib
import os
import pathlib
import signal
import sqlite3
import threading
import time

import common
import heliograph as hg
import numpy as np
import served
from heliograph._wire.launch import find_program
from worker import Worker

LOSSES = common.size(20, 3)
GRACE = 6
PICTURE = {"planes": ["beauty", "depth", "instance"], "spp": 16, "progress": False}


def start(folder, *flags):
    """A daemon whose device, once lost, is lost for the process."""
    environment = {**os.environ, "HELIOGRAPH_TEST_LOSS": "1"}
    state = ("--state-dir", folder / "state", "--grace", GRACE, "--log-level", "info")
    return served.Served(folder, *state, *flags, env=environment)


class Editor(Worker):
    """Makes an entity with each edit, as fast as it is answered, over every loss."""

    def __init__(self, scene):
        self.scene = scene
        self.acknowledged = []  # (revision, id of the entity that it made)
        super().__init__()

    def run(self):
        while not self.stopping.is_set():
            x = len(self.acknowledged) + 1
            with self.scene.edit() as edit:
                made = edit.entity(transform=hg.Pose((x, 0, 0)))
            self.acknowledged.append((edit.revision, made))

    def wrong(self):
        """How many edits are lost, twice, or not where they were."""
        count = len(self.acknowledged)
        gaps = [r for r, _ in self.acknowledged] != list(range(1, count + 1))
        extra = abs(self.scene.describe().counts.entities - count)
        poses = self.scene.transforms([made for _, made in self.acknowledged])
        return gaps + extra + int((poses[:, 0, 3] != range(1, count + 1)).sum())


def lose(daemon, scene, report):
    """Ends the daemon by a loss under a render; seconds until it was gone."""
    waits = []

    def endless():
        with contextlib.suppress(Exception):
            try:
                scene.render("cam", spp=1 << 20, progress=False)
            except hg.Unavailable as error:
                waits.append(error.retry_seconds)

    job = threading.Thread(target=endless)
    job.start()
    time.sleep(0.2)
    begun = time.perf_counter()
    os.kill(daemon.pid, signal.SIGUSR1)
    code = daemon.process.wait(30)
    job.join()
    took = time.perf_counter() - begun
    report.figure("exit code that is not 75", abs(code - 75), 0, slack=False)
    report.figure("renders that were not told when to retry", not any(waits), 0, slack=False)
    return took


def shown_again(scene, seed):
    """A picture, asked for until there is a connection."""
    for _ in range(100):
        try:
            return scene.render("cam", seed=seed, **PICTURE)
        except hg.Unavailable:
            time.sleep(0.1)
    raise TimeoutError("the daemon did not come back")


def differ(frame, before):
    return not all(np.array_equal(frame[plane], before[plane]) for plane in PICTURE["planes"])


def left(folder):
    """Rows of scenes, and files of arrays, in the state directory."""
    with contextlib.closing(sqlite3.connect(folder / "state/journal.db")) as database:
        rows = database.execute("SELECT count(*) FROM scenes").fetchone()[0]
    return rows + sum(path.is_file() for path in (folder / "state/blobs").rglob("*"))


def losses(report, folder):
    """Two clients with a private scene each, one with a shared one too, which edit over losses."""
    daemon = start(folder)
    slowest = wrong = 0
    with hg.connect(daemon.socket) as first, hg.connect(daemon.socket) as second:
        stages = [common.stage(client) for client in (first, second)]
        branch = stages[0].branch()
        shown = [*stages, branch, common.stage(second, name="room", lifetime="daemon")]
        before = [scene.render("cam", seed=k, **PICTURE) for k, scene in enumerate(shown)]
        shared = first.create_scene("edited", lifetime="daemon")
        editors = [Editor(first.create_scene()), Editor(second.create_scene()), Editor(shared)]
        for k in range(LOSSES):
            common.seconds_until(lambda: all(len(e.acknowledged) > 20 * (k + 1) for e in editors))
            slowest = max(slowest, lose(daemon, stages[k % 2], report))
            daemon = start(folder)
            for seed, (scene, old) in enumerate(zip(shown, before, strict=True)):
                wrong += differ(shown_again(scene, seed), old)
        for editor in editors:
            editor.stop()
        report.figure("lost: ended after", slowest, 5, "s", slack=False)
        report.figure("images that differ from the one before", wrong, 0, slack=False)
        edits = sum(len(editor.acknowledged) for editor in editors)
        print(f"  {LOSSES} losses, {edits} edits")
        report.figure("edits lost or twice", sum(e.wrong() for e in editors), 0, slack=False)
    daemon.stop()
    report.figure("left in the state directory", left(folder), 0, slack=False)


def vanished(report, folder):
    """A client that does not come back: what it had is freed after the grace time."""
    daemon = start(folder)
    stays = hg.connect(daemon.socket)
    goes = hg.connect(daemon.socket)
    kept = common.stage(stays)
    common.stage(goes)
    lose(daemon, kept, report)
    daemon = start(folder)
    came = time.perf_counter()
    goes.connection.link.close()  # as if it had been killed
    assert kept.describe().counts.entities > 0
    everybody = common.used(stays, "tenant_entities")
    both = gone_entities = kept.describe().counts.entities
    report.figure("entities that did not come back", 2 * both - everybody, 0, slack=False)
    common.seconds_until(lambda: common.used(stays, "tenant_entities") <= gone_entities)
    took = time.perf_counter() - came
    report.figure("freed after the grace time", took, GRACE + 3, "s")
    report.figure("freed before it", max(0.0, GRACE - 1 - took), 0, "s", slack=False)
    stays.close()
    daemon.stop()
    report.figure("left of it in the state directory", left(folder), 0, slack=False)


def main():
    served.DAEMON = str(pathlib.Path(find_program()).with_name("heliographd-faulty"))
    with common.Report("R14 scenes that are saved") as report:
        with served.folder() as folder:
            losses(report, folder)
        with served.folder() as folder:
            vanished(report, folder)


if __name__ == "__main__":
    main()
