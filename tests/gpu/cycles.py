"""The memory of the GPU and of the daemon over edits and renders, and a picture after them.

usage: .venv/bin/python tests/gpu/cycles.py [CYCLES=10000]   (needs an NVIDIA GPU)
Each cycle moves an object, now and then adds or removes one with a mesh of its own, and renders one
of three sizes. Memory after the first tenth must be that at the end, within 2 MiB on the GPU and 16
on the host; the first frame after an edit must equal its repeat bit for bit, every hundredth cycle.
"""

import pathlib
import subprocess
import sys
import time

import heliograph as hg
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "fault"))
import common

SIZES = ((64, 64), (320, 180), (128, 96))
ALLOWED_MIB = {"GPU": 2, "host": 16}


def used_mib(client):
    ask = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    gpu = sum(int(line) for line in subprocess.check_output(ask, text=True).split())
    return {"GPU": gpu, "host": common.resident(common.pid_of(client)) >> 20}


def furnish(scene):
    with scene.edit() as edit:
        edit.mesh("ball", **hg.shapes.sphere(0.4, 24))
        edit.material("paint", base_color=(0.7, 0.3, 0.2), roughness=0.3)
        for i in range(27):
            at = np.array([i % 3, i // 3 % 3, i // 9], float) - 1
            edit.entity(f"ball/{i}", mesh="ball", material="paint", transform=hg.Pose(at))
        edit.dome(np.random.default_rng(0).random((8, 16, 3)).astype("f4"))
        lens = hg.Camera.from_fov(50, 64, 64, degrees=True)
        edit.entity("camera", camera=lens, transform=hg.look_at((0, -6, 1), (0, 0, 0)))


def change(scene, cycle):
    with scene.edit() as edit:
        edit.entity(f"ball/{cycle % 27}", transform=hg.Pose((0, 0, 0.001 * (cycle % 1000))))
        if cycle % 20 == 5:
            edit.mesh("extra/mesh", **hg.shapes.sphere(0.3, 8 + cycle % 40))
            edit.entity("extra", mesh="extra/mesh", material="paint", transform=hg.Pose((0, 0, 2)))
        if cycle % 20 == 15:
            edit.remove("extra")
            edit.prune()


def main(cycles):
    with hg.connect(arguments=["--backend", "cuda"]) as client, client.create_scene() as scene:
        furnish(scene)
        begin, marks = time.monotonic(), {}
        for cycle in range(cycles):
            change(scene, cycle)
            options = {"size": SIZES[cycle % 3], "spp": 1, "progress": False}
            frame = scene.render("camera", **options)
            if cycle % 100 == 0:
                again = scene.render("camera", **options)
                assert (frame["beauty"] == again["beauty"]).all(), f"cycle {cycle} differs"
            if (cycle + 1) % (cycles // 10) == 0:
                marks[cycle + 1] = used_mib(client)
                print(f"{cycle + 1:6d} cycles, MiB: {marks[cycle + 1]}", flush=True)
        took = (time.monotonic() - begin) / cycles
    first, last = marks[min(marks)], marks[max(marks)]
    grown = {where: last[where] - first[where] for where in first}
    print(f"{cycles} cycles, {took * 1e3:.2f} ms each; MiB: {grown}, allowed {ALLOWED_MIB}")
    sys.exit(any(grown[where] > ALLOWED_MIB[where] for where in grown))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10000)
