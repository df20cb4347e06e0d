"""Milliseconds from an overlay that moves one object to a frame of 1 sample in PyTorch, on a GPU.

usage: bench/gpu_overlay.py [BACKEND=cuda]   Balls of 1,300 triangles in a grid under a dome;
beauty, depth and instance, 4 bounces. HELIOGRAPHD names the daemon; needs PyTorch with CUDA. With
another backend the frames come as numpy arrays.
"""

import statistics
import sys
import time

import heliograph as hg
import numpy as np

PLANES = ["beauty", "depth", "instance"]
CASES = (  # objects, size
    (1000, (1280, 720)),
    (10_000, (1280, 720)),
    (100_000, (1280, 720)),
    (1000, (256, 256)),
    (1000, (64, 64)),
)
WARM, MEASURED = 5, 20


def furnish(scene, count):
    """The names of the balls, on a grid as high as it is wide."""
    side = round(count ** (1 / 3))
    places = np.stack(np.unravel_index(np.arange(count), (side + 1,) * 3), -1) - side / 2
    transforms = np.tile(np.eye(4, dtype="f4"), (count, 1, 1))
    transforms[:, :3, 3] = places
    with scene.edit() as edit:
        edit.dome(np.random.default_rng(0).random((8, 16, 3)).astype("f4"))
        mesh = edit.mesh("ball", **hg.shapes.sphere(0.35, 26))
        edit.material("paint", base_color=(0.7, 0.4, 0.2), roughness=0.4)
        balls = edit.instances("b", mesh=mesh, material="paint", transforms=transforms)
        lens = hg.Camera.from_fov(50, 1280, 720, degrees=True)
        eye = (-1.6 * side, -1.2 * side, 0.8 * side)
        edit.entity("camera", camera=lens, transform=hg.look_at(eye, (0, 0, 0)))
    return balls


def measure(client, count, size, backend):
    options = {"planes": PLANES, "spp": 1, "size": size, "labels": False}
    options["max_depth"] = 4
    if backend == "cuda":
        options["device"] = "cuda"
    times, inside = [], []
    with client.create_scene() as scene:
        balls = furnish(scene, count)
        before = 0
        for i in range(WARM + MEASURED):
            if i == WARM:
                before = client.info().uploaded_bytes
            start = time.perf_counter()
            with scene.overlay() as overlay:
                overlay.entity(balls[i], transform=hg.Pose((0.01 * i, 0.3, 0.2)))
            frame = scene.render("camera", overlay=overlay, seed=i, **options)
            if backend == "cuda":
                frame.torch("beauty")
            times.append(time.perf_counter() - start)
            inside.append(frame.render_seconds)
        sent = (client.info().uploaded_bytes - before) / MEASURED
    median = [1e3 * statistics.median(each[WARM:]) for each in (times, inside)]
    print(
        f"{count:,} objects, {size[0]}x{size[1]}: {median[0]:.2f} ms, {median[1]:.2f} in the "
        f"renderer, {sent / 1e6:.2f} MB uploaded",
        flush=True,
    )


def main(backend):
    with hg.connect(arguments=["--backend", backend]) as client:
        for count, size in CASES:
            measure(client, count, size, backend)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "cuda")
