"""A data set made on Ray by 3 workers while workers and their daemons are killed at random: every
image is there once, and all files are those of an undisturbed run.

usage: see common.py
"""

from __future__ import annotations

import os
import pathlib
import random
import signal
import sys
import tempfile
import threading
import time

import common
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
from heliograph import cluster

COUNT = common.size(1000, 24)
KILLS = common.size(30, 3)
PAUSE = common.size(1.5, 0.4)  # seconds between two, on average
DRAWING = common.size(0, 0.6)  # seconds that a draw takes, so that few images last for all kills
BALLS = [f"ball/{i}" for i in range(3)]


def furnish(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
        poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
        edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.2)))


def scatter(draw):
    time.sleep(DRAWING)
    poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
    poses[:, :2, 3] = draw.rng.uniform(-0.8, 0.8, (len(BALLS), 2))
    poses[:, 2, 3] = 0.2
    draw.place(BALLS, poses)


def processes():
    """pid -> (parent's pid, name) of this machine's."""
    found = {}
    for path in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            name = (path / "cmdline").read_bytes().split(b"\0")[0].decode(errors="replace")
        except (OSError, IndexError):
            continue
        found[int(path.name)] = parent, name
    return found


def victims():
    """(workers, daemons of workers) below this process."""
    found = processes()

    def is_ours(pid):
        while pid in found:
            pid = found[pid][0]
            if pid == os.getpid():
                return True
        return False

    workers = [p for p, (_, name) in found.items() if name.startswith("ray::Maker") and is_ours(p)]
    daemons = [
        p
        for p, (parent, name) in found.items()
        if parent in workers and name.endswith("heliographd")
    ]
    return workers, daemons


class Killer(threading.Thread):
    """Ends workers and daemons in turns, at random times, as kill -9 does."""

    def __init__(self):
        super().__init__(daemon=True)
        self.killed = [0, 0]
        self.over = threading.Event()

    def run(self):
        rng = random.Random(1)
        while sum(self.killed) < KILLS and not self.over.wait(rng.uniform(0, 2 * PAUSE)):
            kind = sum(self.killed) % 2
            found = victims()[kind]
            if found:
                os.kill(rng.choice(found), signal.SIGKILL)
                self.killed[kind] += 1


def files(folder):
    """Name -> bytes of what the data set is made of."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "shards" not in path.parts and "partial" not in path.parts
    }


def main():
    with (
        tempfile.TemporaryDirectory() as work,
        hg.connect() as client,
        client.create_scene() as scene,
        common.Report("A data set on Ray, its workers and daemons killed") as report,
    ):
        furnish(scene)
        disturbed, alone = pathlib.Path(work, "disturbed"), pathlib.Path(work, "alone")
        options = {"count": COUNT, "spp": 2, "seed": 7}
        killer = Killer()
        killer.start()
        done = cluster.generate(
            scene,
            "cam",
            scatter,
            writer=hd.Coco(disturbed),
            workers=3,
            shard=common.size(8, 2),
            tries=50,
            **options,
        )
        killer.over.set()
        killer.join()
        print(f"  {done}; killed: {killer.killed[0]} workers, {killer.killed[1]} daemons")
        hd.generate(scene, "cam", scatter, writer=hd.Coco(alone), **options)
        made, wanted = files(disturbed), files(alone)
        differ = {n for n in made.keys() | wanted.keys() if made.get(n) != wanted.get(n)}
        pictures = [name for name in made if name.endswith(".png")]
        report.figure("pictures too few or too many", abs(len(pictures) - COUNT), 0, slack=False)
        report.figure("files unlike those of an undisturbed run", len(differ), 0, slack=False)
        report.figure(
            "faults found by validate()", len(hd.validate(disturbed).faults), 0, slack=False
        )
        missed = KILLS - sum(killer.killed) if common.SHORT else 0 if sum(killer.killed) else 1
        report.figure("kills that came too late", missed, 0, slack=False)
        if differ:
            print("\n".join(sorted(differ)[:20]), file=sys.stderr)


if __name__ == "__main__":
    main()
