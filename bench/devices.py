"""A batch of frames on one GPU and on several, in turns: frames per second, and a check that the
pictures are the same.

usage: .venv/bin/python bench/devices.py [DEVICES=2]   (needs so many NVIDIA GPUs)
"""

import statistics
import sys
import time

import heliograph as hg
from gpu import furnish

FRAMES, SPP, ROUNDS = 32, 16, 3


def seconds(scene):
    """Time of the batch, seconds, and its first pictures."""
    jobs = [hg.Job("camera", seed=i, spp=SPP, max_depth=8, tag=i) for i in range(FRAMES)]
    start, kept = time.perf_counter(), {}
    for result in scene.render_batch(jobs, credits=16):
        if result.tag < 4:
            kept[result.tag] = result.frame["beauty"].copy()
    return time.perf_counter() - start, kept


def main(devices):
    one, many = (
        ["--backend", "cuda", "--devices", "1"],
        ["--backend", "cuda", "--devices", str(devices)],
    )
    with hg.connect(arguments=one) as a, hg.connect(arguments=many) as b:
        scenes = [a.create_scene(), b.create_scene()]
        took = [[], []]
        for scene in scenes:
            furnish(scene, 1000)
            seconds(scene)  # caches
        for _ in range(ROUNDS):
            pictures = []
            for scene, times in zip(scenes, took, strict=True):
                last, kept = seconds(scene)
                times.append(last)
                pictures.append(kept)
            same = all((pictures[0][i] == pictures[1][i]).all() for i in range(4))
        rates = [FRAMES / statistics.median(times) for times in took]
        print(
            f"1 GPU {rates[0]:.1f} frames/s, {devices} GPUs {rates[1]:.1f}:"
            f" {rates[1] / rates[0]:.2f} times; the same bytes: {same}"
        )
        sys.exit(not same)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
