"""Cost of a call from Python over the Unix socket, and the number of transforms per second.

usage: .venv/bin/python bench/pingpong.py [ADDRESS]   (default: a private daemon)
`ninja -C build/cpu bench_client && build/cpu/bin/bench_client` has the same for C++.
"""

import sys
import time

import heliograph as hg
import numpy as np

MANY = 10_000


def latency(name, call, promised=None, count=2000):
    for i in range(count // 10):
        call(i)
    times = []
    for i in range(count):
        start = time.perf_counter()
        call(i)
        times.append(1e3 * (time.perf_counter() - start))
    median, late = np.percentile(times, [50, 99])
    promise = f", promised <= {promised} ms" if promised else ""
    print(f"{name:34} {median:8.3f} ms median {late:8.3f} ms p99{promise}", flush=True)


def build(client):
    scene = client.create_scene()
    with scene.edit() as edit:
        mesh = edit.mesh("mesh", **hg.shapes.cube(1))
        ball = edit.entity("cube", mesh=mesh)
        lens = hg.Camera.from_fov(50, 16, 16, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))
        many = edit.instances("many", transforms=np.tile(np.eye(4, dtype="f4"), (MANY, 1, 1)))
    return scene, ball, many


def transforms(scene, many, count=100):
    """Millions a second, a message of 10,000 after the other."""
    poses = np.tile(np.eye(4, dtype="f4"), (MANY, 1, 1))
    start = time.perf_counter()
    for i in range(count):
        poses[:, 0, 3] = i
        with scene.edit() as edit:
            edit.set_transforms(many, poses)
    return 1e-6 * count * MANY / (time.perf_counter() - start)


def handed_over(scene, count=60):
    """Milliseconds that a frame of 8.4 MB takes more than one of 16x16, rendering and the writing
    of its pixels apart: medians, each after a pause as long as the large one is rendered."""
    options = {"planes": ["position", "depth"], "labels": False, "progress": False}
    times = {(1024, 512): [], (16, 16): []}
    for _ in range(count):
        for size, seen in times.items():
            time.sleep(0.03)
            start = time.perf_counter()
            frame = scene.render("cam", size=size, **options)
            seen.append(1e3 * (time.perf_counter() - start - frame.render_seconds))
    large, small = (float(np.median(seen)) for seen in times.values())
    return large - small


def main(address=None):
    options = {} if address else {"arguments": ["--log-level", "warning"]}
    with hg.connect(address, **options) as client:
        scene, ball, many = build(client)

        def move(i):
            with scene.edit() as edit:
                edit.update(ball, transform=hg.Pose((0.001 * (i % 7), 0, 0)))

        tiny = {"planes": ["depth"], "labels": False, "progress": False}
        latency("a call (revision)", lambda _: scene.revision, 0.4)
        latency("edit, acknowledged", move, 0.4)
        latency("frame 16x16 depth", lambda _: scene.render("cam", **tiny))
        beyond = handed_over(scene)
        print(f"{'8.4 MB frame beyond a small one':34} {beyond:8.3f} ms median, promised <= 0.5 ms")
        rates = sorted(transforms(scene, many) for _ in range(5))
        print(f"{'transforms':34} {rates[2]:8.2f} million/s median, promised >= 3")


if __name__ == "__main__":
    main(*sys.argv[1:])
