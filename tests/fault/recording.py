"""Cost of recording (--record): edits, frames and questions, with and without; its bytes."""

import pathlib
import tempfile
import time

import heliograph as hg
import numpy as np
from common import Report, daemon, size, stage

EDITS = size(5000, 150)
FRAMES = size(500, 15)
READS = size(100, 10)
QUESTIONS = size(2000, 100)
VERTICES = 1_000_000


def move(scene, x):
    with scene.edit() as edit:
        edit.entity("ball", transform=hg.Pose((x % 7, 0, 0.5)))


def measure(scenes, act, count):
    """The median of `count` acts, for each scene; in turn, so that both meet the same load."""
    taken = [[], []]
    for x in range(count):
        for index in (0, 1) if x % 2 else (1, 0):
            start = time.perf_counter()
            act(scenes[index], x)
            taken[index].append(time.perf_counter() - start)
    return [float(np.median(each)) for each in taken]


def show(scene, _):
    scene.render("cam", planes=["depth", "normal", "instance"], labels=False)


def ask(scene, x):
    scene.pick("cam", np.full((100, 2), x % 256))


def read(scene, _):
    scene.read(["cloth"], ["mesh.positions"])


def furnished(client):
    scene = stage(client)
    positions = np.random.default_rng(1).random((VERTICES, 3), np.float32)
    with scene.edit() as edit:
        edit.mesh("cloth", positions=positions, indices=[(0, 1, 2)])
    return scene


COSTS = (
    ("edit", move, EDITS, 0.25),
    ("frame, 1.3 MB", show, FRAMES, 0.25),
    ("query, 100 pixels", ask, QUESTIONS, 0.25),
    ("read, 12 MB", read, READS, 0.25),
)


def main():
    with Report("recording") as report, tempfile.TemporaryDirectory(prefix="hg-") as folder:
        path = pathlib.Path(folder) / "cost.recording"
        with daemon() as plain, daemon("--record", str(path)) as recorded:
            plain.connection.link.quick = None  # a recording has what comes by gRPC
            scenes = furnished(plain), furnished(recorded)
            for name, act, count, more in COSTS:
                time.sleep(0.3)  # the writer has caught up
                before = path.stat().st_size
                without, with_it = measure(scenes, act, count)
                time.sleep(0.3)
                each = (path.stat().st_size - before) / count
                report.figure(f"{name}: without", without * 1e3, 1000, "ms")
                report.figure(f"{name}: share more when recorded", with_it / without - 1, more)
                report.figure(f"{name}: bytes of the recording", each, 4096, "B", slack=False)


if __name__ == "__main__":
    main()
