"""What recording (--record) costs: edits and frames with it and without, and its bytes."""

import pathlib
import tempfile
import time

import heliograph as hg
import numpy as np
from common import Report, daemon, size, stage

ROUNDS = size(10, 3)  # with and without in turn, so that both meet the same load
EDITS = size(500, 50)  # a round
FRAMES = size(50, 5)


def seconds_of(act, count):
    """How long each of `count` acts took."""
    taken = []
    for x in range(count):
        start = time.perf_counter()
        act(x)
        taken.append(time.perf_counter() - start)
    return taken


def move(scene, x):
    with scene.edit() as edit:
        edit.entity("ball", transform=hg.Pose((x % 7, 0, 0.5)))


def measure(scenes, act, count):
    """The median over all rounds, for each scene."""
    taken = [[], []]
    for _ in range(ROUNDS):
        for index, scene in enumerate(scenes):
            taken[index] += seconds_of(lambda x, scene=scene: act(scene, x), count)
    return [float(np.median(each)) for each in taken]


def show(scene, _):
    scene.render("cam", planes=["depth", "normal", "instance"], labels=False)


def main():
    with Report("recording") as report, tempfile.TemporaryDirectory(prefix="hg-") as folder:
        path = pathlib.Path(folder) / "cost.recording"
        with daemon() as plain, daemon("--record", str(path)) as recorded:
            scenes = stage(plain), stage(recorded)
            for name, act, count in (("edit", move, EDITS), ("frame, 1.3 MB", show, FRAMES)):
                time.sleep(0.3)  # the writer has caught up
                before = path.stat().st_size
                without, with_it = measure(scenes, act, count)
                time.sleep(0.3)
                each = (path.stat().st_size - before) / (ROUNDS * count)
                report.figure(f"{name}: without", without * 1e3, 1000, "ms")
                report.figure(f"{name}: share more when recorded", with_it / without - 1, 0.25)
                report.figure(f"{name}: bytes of the recording", each, 4096, "B", slack=False)


if __name__ == "__main__":
    main()
