"""Share of one task of a data set of dice: make.sh runs it in a SLURM array, and
deploy/kubernetes/dataset in an indexed Job.

usage: make.py OUT_DIR COUNT [--task N --tasks N] [--threads N | --address ADDRESS] [--size W H]
               [--spp N]
"""

import argparse
import resource
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
from heliograph import cluster

DICE = [f"die/{i}" for i in range(12)]


def build(scene: hg.Scene, size: tuple[int, int]) -> None:
    """Builds the scene, the same in every task, so that they make one data set."""
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("die/mesh", **hg.shapes.cube(0.2))
        poses = np.tile(np.eye(4), (len(DICE), 1, 1))
        edit.instances("die", mesh=mesh, transforms=poses, category="die")
        lens = hg.Camera.from_fov(45, *size, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -2, 1.4), (0, 0, 0)))


def throw(draw: hd.Draw) -> None:
    places = draw.rng.uniform(-0.8, 0.8, (len(DICE), 2))
    turns = draw.rng.uniform(0, 2 * np.pi, len(DICE))
    at = zip(places, turns, strict=True)
    draw.place(DICE, [hg.Pose((x, y, 0.1), euler=(0, 0, turn)) for (x, y), turn in at])


def cpu_seconds() -> float:
    """CPU seconds of this process and of the daemon that it ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("count", type=int)
    parser.add_argument("--task", type=int, default=0)
    parser.add_argument("--tasks", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1, help="of a daemon of its own")
    parser.add_argument("--address", help="of a daemon that runs")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--spp", type=int, default=64)
    options = parser.parse_args()
    start = time.monotonic()
    arguments = [] if options.address else ["--threads", str(options.threads)]
    with (
        hg.connect(options.address, arguments=arguments) as client,
        client.create_scene() as scene,
    ):
        build(scene, options.size)
        done = hd.generate(
            scene,
            "cam",
            throw,
            count=options.count,
            writer=hd.Coco(options.out),
            indices=cluster.share(options.count, options.task, options.tasks),
            spp=options.spp,
            seed=0,
        )
    made, seconds = max(1, done.images), time.monotonic() - start
    print(
        f"task {options.task} of {options.tasks}: {done.images} images, {done.skipped} were there, "
        f"{done.images / seconds:.2f} images per second, {cpu_seconds() / made:.3g} core-seconds "
        f"an image{'; all images are there' if done.complete else ''}"
    )


if __name__ == "__main__":
    main()
