"""Worlds in one call against a render each: milliseconds a picture, in one run, alternating.

usage: bench/worlds.py [WORLDS] [ROUNDS] [BACKEND]   A scene of 20 objects under a dome and a lamp,
pictures of 64 x 64 with beauty at 1 sample, depth and instance, all poses moved each time.
HELIOGRAPHD names the daemon.
"""

import os
import sys
import time

import heliograph as hg
import numpy as np

OBJECTS, SIZE = 20, 64
PLANES = ["beauty", "depth", "instance"]


def build(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        ball = edit.mesh("ball", **hg.shapes.sphere(0.2, segments=32))
        for i in range(4):
            edit.material(f"paint/{i}", base_color=(0.2 * i, 0.5, 0.8 - 0.2 * i), roughness=0.3)
        names = [f"ball/{i}" for i in range(OBJECTS)]
        for i, name in enumerate(names):
            edit.entity(name, mesh=ball, material=f"paint/{i % 4}", label="auto")
        light = hg.Light(power=20, shape="sphere", radius=0.1)
        edit.entity("lamp", light=light, transform=hg.Pose((0, 0, 3)))
        lens = hg.Camera.from_fov(50, SIZE, SIZE, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 2), (0, 0, 0.5)))
    return [scene[name] for name in names]


def poses(count, rng):
    """(N, 20, 4, 4) float32."""
    out = np.tile(np.eye(4, dtype=np.float32), (count, OBJECTS, 1, 1))
    out[..., :3, 3] = rng.uniform((-1.5, -1.5, 0.2), (1.5, 1.5, 1.2), (count, OBJECTS, 3))
    return out


class Bench:
    def __init__(self, scene, count):
        self.scene, self.count = scene, count
        self.balls = build(scene)
        self.worlds = hg.Worlds(count)
        self.rng = np.random.default_rng(1)
        self.rays = 0

    def together(self):
        self.worlds.set_transforms(self.balls, poses(self.count, self.rng))
        batch = self.scene.render_worlds("cam", self.worlds, **OPTIONS)
        self.rays = batch.rays

    def overlays(self):
        for matrices in poses(self.count, self.rng):
            with self.scene.overlay() as overlay:
                overlay.set_transforms(self.balls, matrices)
            yield overlay

    def one_by_one(self):
        for i, overlay in enumerate(self.overlays()):
            self.scene.render("cam", overlay=overlay, seed=i, **OPTIONS)

    def as_a_batch(self):
        jobs = (
            hg.Job("cam", overlay=overlay, seed=i, **OPTIONS)
            for i, overlay in enumerate(self.overlays())
        )
        for result in self.scene.render_batch(jobs):
            result.frame["depth"]


OPTIONS = {"planes": PLANES, "spp": 1, "labels": False}


def main(count, rounds, backend):
    with hg.connect(arguments=["--backend", backend]) as client, client.create_scene() as scene:
        bench = Bench(scene, count)
        kinds = {
            "render_worlds": bench.together,
            "render, one after another": bench.one_by_one,
            "render_batch, 4 at once": bench.as_a_batch,
        }
        took = {name: [] for name in kinds}
        for number in range(rounds + 1):  # the first one is warming up
            for name, run in kinds.items():
                start = time.perf_counter()
                run()
                if number > 0:
                    took[name].append((time.perf_counter() - start) / count * 1e3)
    first = np.median(took["render_worlds"])
    print(f"{count} worlds of {SIZE} x {SIZE}, {OBJECTS} objects, {os.cpu_count()} CPUs")
    for name, times in took.items():
        median = np.median(times)
        print(f"{name:28s}{median:8.2f} ms a picture, {median / first:5.2f} times")
    print(f"rays a picture: {bench.rays / count:.0f}")


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 64,
        int(sys.argv[2]) if len(sys.argv) > 2 else 10,
        sys.argv[3] if len(sys.argv) > 3 else "embree",
    )
