"""Pairs of runs that begin at once in one empty directory: by two processes, two threads, two tasks
of an array and two calls on Ray, with several writers and resume=. Of two that differ exactly one
goes on, the other is refused by the name of what differs, and no file is of it; two that are equal
end with the bytes of one.

usage: see common.py; a number: pairs of different ones (200), a tenth of it are equal
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pathlib
import shutil
import sys
import tempfile
import threading
from collections import Counter

import common
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
from heliograph import cluster

PAIRS = next((int(word) for word in sys.argv[1:] if word.isdigit()), common.size(200, 6))
HOW = ("processes", "threads", "array", "processes", "threads")
RAY = 10  # one of so many pairs is on Ray, but for short runs, which would wait for it to start
BALLS = [f"ball/{i}" for i in range(3)]
PLAIN = {"seed": 7, "writer": "Coco", "splits": {"train": 0.5, "val": 0.5}}
OTHER = [  # what the second run has another of, and what the refusal calls it
    ({"seed": 8}, "seed"),
    ({"spp": 2}, "options.spp"),
    ({"size": (40, 24)}, "options.size"),
    ({"splits": None}, "splits"),
    ({"scene": "other"}, "scene"),
    ({"writer": "Yolo"}, "writer.format"),
    ({"picture": "jpg"}, "writer.picture.format"),
    ({"seed": 8, "resume": False}, "seed"),
    ({"seed": 8, "also": "second"}, "seed"),
]
WRITERS = ("Coco", "Yolo", "Exr", "WebDataset", "Parquet", "Ndds", "NerfTransforms")
COUNT = 6


def furnish(scene, radius):
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(radius))
        poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
        edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
        lens = hg.Camera.from_fov(50, 32, 24, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.2)))


def scatter(draw):
    poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
    poses[:, :2, 3] = draw.rng.uniform(-0.8, 0.8, (len(BALLS), 2))
    poses[:, 2, 3] = 0.2
    draw.place(BALLS, poses)


def writers_of(out, settings):
    """With "also" two: of the runs that want both directories, the second names them the other way
    round."""
    make = getattr(hd, settings["writer"])
    picture = settings.get("picture", "png")
    roots = [out]
    if "also" in settings:
        roots.append(out.with_name(f"{out.name}-also"))
    if settings.get("also") == "second":
        roots.reverse()
    return [make(root, picture=picture) for root in roots]


class Scenes:
    """Two scenes of a daemon, and runs of them."""

    def __init__(self, client):
        self.made = {}
        for name, radius in (("plain", 0.2), ("other", 0.25)):
            self.made[name] = client.create_scene()
            furnish(self.made[name], radius)

    def run(self, out, settings, how="processes"):
        """(images made or None, the message)"""
        options = {key: settings[key] for key in ("seed", "splits")}
        options |= {"spp": settings.get("spp", 1), "size": settings.get("size", (32, 24))}
        if how == "ray":
            make, options["workers"] = cluster.generate, 1
            options["connect"] = {"arguments": ["--threads", "1"]}
        else:
            make, options["indices"] = hd.generate, settings.get("indices")
        scene = self.made[settings.get("scene", "plain")]
        options |= {"count": COUNT, "resume": settings.get("resume", True)}
        try:
            done = make(scene, "cam", scatter, writer=writers_of(out, settings), **options)
        except Exception as error:  # what names nothing counts as such
            return None, str(error) or repr(error)
        return done.images + done.skipped, repr(done)


def connected():
    return hg.connect(arguments=["--threads", "1"])


def work(pipe, barrier):
    """A process that makes the set it gets, when the other one does."""
    with connected() as client:
        scenes = Scenes(client)
        pipe.send("ready")
        while job := pipe.recv():
            barrier.wait()
            pipe.send(scenes.run(*job))


class Pair:
    """Two who make a data set at once: two processes, or two threads of this one."""

    def __init__(self, stack):
        self.scenes = Scenes(stack.enter_context(connected()))
        context = multiprocessing.get_context("spawn")
        barrier, self.pipes = context.Barrier(2), []
        for _ in range(2):
            mine, others = context.Pipe()
            process = context.Process(target=work, args=(others, barrier), daemon=True)
            process.start()
            self.pipes.append(mine)
            stack.callback(process.join, 30)
            stack.callback(mine.send, None)
        for pipe in self.pipes:
            assert pipe.recv() == "ready"

    def run(self, out, both, how):
        """The result of each of them."""
        if how in ("threads", "ray"):
            return self._by_threads(out, both, how)
        for pipe, settings in zip(self.pipes, both, strict=True):
            pipe.send((out, settings))
        return [pipe.recv() for pipe in self.pipes]

    def _by_threads(self, out, both, how):
        barrier, results = threading.Barrier(2), [(None, "raised")] * 2

        def run(number):
            barrier.wait()
            results[number] = self.scenes.run(out, both[number], how)

        threads = [threading.Thread(target=run, args=(number,)) for number in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return results


def files(*roots):
    """Name -> bytes of what data sets are made of."""
    return {
        f"{number}/{path.relative_to(root)}": path.read_bytes()
        for number, root in enumerate(roots)
        for path in sorted(root.rglob("*"))
        if path.is_file() and not {"shards", "partial", "runs"} & {*path.parts}
    }


def roots_of(out, settings):
    return sorted((w.directory for w in writers_of(out, settings)), key=lambda root: root.name)


class Alone:
    """Files that an undisturbed run makes."""

    def __init__(self, work, scenes):
        self.work, self.scenes, self.known = work, scenes, {}

    def files(self, settings):
        # a directory's name is in some formats' files
        key = repr(sorted((k, v) for k, v in settings.items() if k != "resume"))
        if key not in self.known:
            out = self.work / "alone" / "set"
            made, message = self.scenes.run(out, settings)
            assert made, message
            self.known[key] = files(*roots_of(out, settings))
            shutil.rmtree(out.parent)
        return self.known[key]


def of_pair(number, equal):
    """(settings of both, how, what differs)"""
    how = HOW[number % len(HOW)]
    if number % RAY == RAY - 1 and not common.SHORT:
        how = "ray"
    one = dict(PLAIN, writer=WRITERS[number % len(WRITERS)])
    change, name = ({}, "") if equal else OTHER[number % len(OTHER)]
    if one["writer"] == change.get("writer"):
        one["writer"] = "Coco"
    if "also" in change or (equal and number % 2):
        one["also"] = "first"
    if equal and number % 3 == 0:
        one["resume"] = False
    other = {**one, **change}
    if how == "array":
        for task, settings in enumerate((one, other)):
            settings["indices"] = cluster.share(COUNT, task, 2)
    both = [one, other]
    return both[:: 1 if number % 2 else -1], how, name


def watch_one(pair, alone, number, found):
    both, how, name = of_pair(number, False)
    out = pair_folder(alone.work)
    results = pair.run(out, both, how)
    winners = [index for index, (made, _) in enumerate(results) if made is not None]
    if len(winners) != 1:
        found["not one"] += 1
        print(f"  pair {number}, {how}, {both}: {results}", file=sys.stderr)
        return
    found[how] += 1
    won, (_, refusal) = both[winners[0]], results[1 - winners[0]]
    found["unnamed"] += f"is a data set with another {name}" not in refusal
    check(alone, out, won, number, found)


def check(alone, out, settings, number, found):
    made, wanted = files(*roots_of(out, settings)), alone.files(settings)
    differ = {name for name in made.keys() | wanted.keys() if made.get(name) != wanted.get(name)}
    if differ:
        found["unlike"] += 1
        print(f"  pair {number}, {settings}: {sorted(differ)[:8]}", file=sys.stderr)
    if "indices" not in settings:
        found["faults"] += sum(len(hd.validate(r).faults) for r in roots_of(out, settings))


def pair_folder(work):
    """An empty directory that has the name that Alone's have."""
    out = work / "pair" / "set"
    shutil.rmtree(out.parent, ignore_errors=True)
    return out


def watch_equal(pair, alone, number, found):
    both, how, _ = of_pair(number, True)
    out = pair_folder(alone.work)
    results = pair.run(out, both, how)
    refused = [text for made, text in results if made is None]
    found["equal refused"] += len(refused)
    if refused:
        print(f"  equal pair {number}, {how}: {refused}", file=sys.stderr)
    whole = {key: value for key, value in both[0].items() if key != "indices"}
    check(alone, out, whole, number, found)


def main():
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.ExitStack() as stack,
        common.Report("Two runs at once in one directory") as report,
    ):
        pair, work = Pair(stack), pathlib.Path(folder)
        alone, found = Alone(work, pair.scenes), Counter()
        if PAIRS >= RAY and not common.SHORT:
            here = str(pathlib.Path(__file__).parent)
            os.environ["PYTHONPATH"] = os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])
            stack.enter_context(cluster._ray(2, 0))
        for number in range(PAIRS):
            watch_one(pair, alone, number, found)
        for number in range(max(2, PAIRS // 10)):
            watch_equal(pair, alone, number, found)
        ways = {how: found[how] for how in (*dict.fromkeys(HOW), "ray")}
        print(f"  exactly one went on: {sum(ways.values())} of {PAIRS}; {ways}")
        for name, key in (
            ("pairs of which not exactly one went on", "not one"),
            ("refusals that do not name what differs", "unnamed"),
            ("equal runs that were refused", "equal refused"),
            ("data sets unlike one undisturbed run", "unlike"),
            ("faults found by validate()", "faults"),
        ):
            report.figure(name, found[key], 0, slack=False)


if __name__ == "__main__":
    main()
