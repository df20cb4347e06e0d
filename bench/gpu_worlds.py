"""Worlds that stay on one GPU: pictures per second, all poses new in each call, from a tensor on
the GPU into packed tensors there.

usage: bench/gpu_worlds.py [ROUNDS]   The scene of bench/worlds.py. HELIOGRAPHD names the daemon;
needs PyTorch with CUDA. Also compares a few pictures with those of single renders, bit for bit, and
ends with 1 where they differ.
"""

import sys
import time

import heliograph as hg
import numpy as np
import torch
import worlds as scenes

PLANES = ["beauty", "depth", "instance"]
CASES = (  # worlds, size, samples, label columns
    (4096, 64, 1, False),
    (1024, 64, 1, False),
    (256, 128, 1, True),
    (256, 128, 4, False),
    (256, 128, 4, True),
)


def poses(count, seed):
    return scenes.poses(count, np.random.default_rng(seed))


def differing(scene, balls, size):
    """Number of planes, in a few of 300 worlds, that differ from a single render's."""
    worlds, matrices = hg.Worlds(300), poses(300, 7)
    worlds.set_transforms(balls, torch.from_numpy(matrices).cuda())
    options = {"planes": PLANES, "spp": 2, "size": (size, size), "labels": False}
    frame = scene.render_worlds("cam", worlds, device="cuda", **options)
    wrong = 0
    for i in (0, 1, 255, 256, 299):
        with scene.overlay() as overlay:
            overlay.set_transforms(balls, matrices[i])
        seed = int(frame.seeds[i])
        alone = scene.render("cam", overlay=overlay, seed=seed, **options)
        for plane in PLANES:
            wrong += not np.array_equal(frame.torch(plane)[i, 0].cpu().numpy(), alone[plane])
    return wrong


def measure(scene, balls, case, rounds):
    count, size, spp, labels = case
    worlds = hg.Worlds(count)
    options = {"planes": PLANES, "spp": spp, "size": (size, size), "labels": labels}
    times, inside = [], []
    for number in range(rounds + 1):  # the first one is warming up
        matrices = torch.from_numpy(poses(count, number)).cuda()
        torch.cuda.synchronize()
        start = time.perf_counter()
        worlds.set_transforms(balls, matrices)
        frame = scene.render_worlds("cam", worlds, device="cuda", **options)
        pixels = frame.torch("beauty")
        torch.cuda.synchronize()
        if number > 0:
            times.append(time.perf_counter() - start)
            inside.append(frame.render_seconds)
        assert tuple(pixels.shape[:4]) == (count, 1, size, size)
        del frame, pixels
    return np.median(times), np.median(inside)


def main(rounds):
    arguments = ["--backend", "cuda"]
    with hg.connect(arguments=arguments) as client, client.create_scene() as scene:
        balls = scenes.build(scene)
        wrong = differing(scene, balls, 64) + differing(scene, balls, 50)
        print(f"planes that are not a single render's: {wrong} of 30")
        print(f"{scenes.OBJECTS} objects, {', '.join(PLANES)}; medians of {rounds}")
        for case in CASES:
            count, size, spp, labels = case
            whole, inside = measure(scene, balls, case, rounds)
            with_labels = ", label columns" if labels else ""
            print(
                f"{count} worlds of {size} x {size}, {spp} spp{with_labels}: {whole * 1e3:.1f} ms "
                f"({inside * 1e3:.1f} of films), {count / whole:,.0f} pictures per second",
                flush=True,
            )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
