"""Speed of a backend on 1,000 objects: paths per second, and frames after an edit.

usage: .venv/bin/python bench/gpu.py [BACKEND=cuda]
"""

import statistics
import sys
import time

import heliograph as hg
import numpy as np


def furnish(scene, count):
    """`count` balls of 1,280 triangles with ten materials on a grid, under a sky with a sun."""
    rng = np.random.default_rng(1)
    side = round(count ** (1 / 3))
    with scene.edit() as edit:
        sky = np.full((32, 64, 3), (0.35, 0.5, 0.8), "f4")
        sky[5, 12] = (900, 800, 700)
        edit.dome(sky)
        edit.mesh("ball", **hg.shapes.sphere(0.35, 26))
        for i in range(10):
            look = {"base_color": rng.random(3), "metallic": i % 2, "roughness": 0.1 + 0.08 * i}
            edit.material(f"m{i}", **look)
        for i in range(count):
            at = np.array([i % side, i // side % side, i // side**2], float) - side / 2
            edit.entity(f"b{i}", mesh="ball", material=f"m{i % 10}", transform=hg.Pose(at))
        lens = hg.Camera.from_fov(50, 1280, 720, degrees=True)
        eye = (-1.6 * side, -1.2 * side, 0.8 * side)
        edit.entity("camera", camera=lens, transform=hg.look_at(eye, (0, 0, 0)))


def timed(scene, repeats, **options):
    """Seconds of the renderer, the median."""
    seconds = []
    for i in range(repeats):
        frame = scene.render("camera", seed=i, progress=False, **options)
        seconds.append(frame.render_seconds)
    return statistics.median(seconds)


def main(backend):
    with hg.connect(arguments=["--backend", backend]) as client, client.create_scene() as scene:
        furnish(scene, 1000)
        start = time.perf_counter()
        scene.render("camera", spp=1, progress=False)
        print(f"{backend}: first frame {time.perf_counter() - start:.3f} s")
        for depth in (2, 8):
            for spp in (16, 64):
                took = timed(scene, 3, spp=spp, max_depth=depth)
                rate = 1280 * 720 * spp / took / 1e6
                print(f"720p {spp} spp depth {depth}: {took * 1e3:.1f} ms, {rate:.1f} M paths/s")
        for size in ((1280, 720), (256, 256), (64, 64)):
            took = timed(scene, 9, spp=1, max_depth=8, size=size)
            print(f"{size[0]}x{size[1]} 1 spp depth 8: {took * 1e3:.2f} ms in the renderer")
        edited = []
        for i in range(20):
            start = time.perf_counter()
            with scene.edit() as edit:
                edit.entity("b7", transform=hg.Pose((0, 0, 0.01 * i)))
            scene.render("camera", spp=1, max_depth=4, progress=False)
            edited.append(time.perf_counter() - start)
        print(f"edit to a 720p frame in numpy, depth 4: {statistics.median(edited) * 1e3:.1f} ms")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "cuda")
