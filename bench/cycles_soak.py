"""Memory over cycles of create, render, delete. usage: cycles_soak.py [CYCLES=10000]

Run with .venv/bin/python. Fails when memory grows by more than 5 MB in the second half.
"""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import heliograph as hg
import numpy as np
import usage

ALLOWED_MB = 5.0


def resident(pid):
    with open(f"/proc/{pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS")) / 1024


def cycle(client, rng):
    """A scene with a mesh, a texture, a light and a camera, made, rendered and deleted."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            texture = edit.texture("texture", rng.integers(0, 255, (32, 32, 3), dtype=np.uint8))
            material = edit.material("material", base_color=texture)
            ball = edit.mesh("ball", **hg.shapes.sphere(segments=16))
            edit.entity("ball/0", mesh=ball, material=material, label="auto")
            edit.dome(rng.uniform(0, 1, (4, 8, 3)).astype("f4"))
            lens = hg.Camera.from_fov(50, 16, 16, degrees=True)
            camera = edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))
        frame = scene.render(camera, planes=["beauty", "instance"], spp=1, progress=False)
        assert np.isfinite(frame["beauty"]).all()
        assert frame["instance"].max() == 1


def main(cycles):
    rng = np.random.default_rng(0)
    with hg.connect(arguments=["--threads", "2"]) as client:
        pids = [os.getpid(), *usage.children(os.getpid())]
        marks = {}
        for done in range(1, cycles + 1):
            cycle(client, rng)
            if done % max(1, cycles // 10) == 0:
                marks[done] = [resident(pid) for pid in pids]
                print(f"{done:6d} cycles", *(f"{mb:8.1f} MB" for mb in marks[done]), flush=True)
    half = marks[min(marks, key=lambda done: abs(done - cycles / 2))]
    growth = sum(marks[max(marks)]) - sum(half)
    print(f"second half: {growth:+.2f} MB, allowed {ALLOWED_MB}")
    return 0 if growth < ALLOWED_MB else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000))
