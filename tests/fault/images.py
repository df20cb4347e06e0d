"""Pictures of ever new textures, meshes and domes, drawn one after the other: the daemon and its
client take no more memory for many than for a hundred.
"""

import gc
import os

import common
import heliograph as hg
import numpy as np
import served

IMAGES = common.size(10_000, 300)
FEW = 100  # until everything that is kept was made once
MEBIBYTE = 1 << 20


def draw(scene, number):
    """Replaces all that the last picture was of: 3 MiB of texels, more than a message takes."""
    random = np.random.default_rng(number)
    texels = random.integers(0, 255, (1024, 1024, 3), "u1")
    sky = random.random((64, 128, 3)).astype("f2")
    with scene.edit() as edit:
        edit.dome(sky)
        paint = edit.material("paint", base_color=edit.texture("texels", texels))
        mesh = edit.mesh("mesh", **hg.shapes.sphere(random.uniform(0.3, 1), segments=48))
        edit.entity("ball", mesh=mesh, material=paint)
    return scene.render("cam", spp=1, planes=["beauty", "instance"])


def main():
    with (
        common.Report("pictures of new things") as report,
        served.served() as daemon,
        hg.connect(daemon.socket) as client,
    ):
        pids = {"daemon": daemon.pid, "client": os.getpid()}
        scene = common.stage(client, 64, 64)
        seen = {name: [] for name in pids}
        for number in range(IMAGES):
            draw(scene, number)
            if number < FEW or number % 20 != 0:
                continue
            gc.collect()
            for name, pid in pids.items():
                seen[name].append(common.resident(pid) / MEBIBYTE)
        for name, sizes in seen.items():
            half = len(sizes) // 2
            grown = max(sizes[half:]) - max(sizes[:half])
            print(f"  {name}: {sizes[0]:.0f} MiB after {FEW}, {sizes[-1]:.0f} after {IMAGES}")
            report.figure(f"{name}: growth in the second half", grown, 10, "MiB")


if __name__ == "__main__":
    main()
