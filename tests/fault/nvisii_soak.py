"""Scripts of import nvisii that make, show and remove things for hours: no growth.

usage: .venv/bin/python tests/fault/nvisii_soak.py [--short] [ROUNDS=100000]
"""

import gc
import sys
import time
import tracemalloc

import common
import heliograph as hg
import numpy as np
import nvisii

WARM = common.size(2000, 60)
LOOK = common.size(2000, 40)


def rounds():
    given = [word for word in sys.argv[1:] if not word.startswith("-")]
    return int(given[0]) if given else common.size(100_000, 240)


def begin(address):
    nvisii.initialize(headless=True, address=address)
    place = nvisii.transform.create("eye")
    place.look_at(at=(0, 0, 0), up=(0, 0, 1), eye=(0, -4, 0))
    eye = nvisii.entity.create("eye", transform=place, camera=nvisii.camera.create("eye"))
    nvisii.set_camera_entity(eye)
    nvisii.set_dome_light_color((1, 1, 1))


def visit(number):
    """One of everything comes, is shown, moves and goes."""
    name, rng = f"thing{number}", np.random.default_rng(number)
    image = nvisii.texture.create_from_data(name, 64, 64, rng.random(64 * 64 * 4, np.float32))
    look = nvisii.material.create(name)
    look.set_base_color_texture(image)
    place = nvisii.transform.create(name)
    shape = nvisii.mesh.create_from_data(name, positions=rng.random(900, np.float32))
    nvisii.entity.create(name, transform=place, mesh=shape, material=look)
    lamp = nvisii.light.create(name)
    above = nvisii.transform.create(f"{name}/lamp", position=(0, 0, 3))
    nvisii.entity.create(f"{name}/lamp", transform=above, light=lamp)
    nvisii.render(16, 16, 1)
    place.set_position((1, 0, 0))
    nvisii.render(16, 16, 1)
    for kind in (nvisii.entity, nvisii.transform):
        kind.remove(f"{name}/lamp")
    for kind in (nvisii.texture, nvisii.entity, nvisii.transform, nvisii.mesh, nvisii.material):
        kind.remove(name)
    nvisii.light.remove(name)


def main():
    with common.Report("nvisii: make, show, remove") as report, hg.connect() as client:
        begin(client.address)
        daemon = common.pid_of(client)
        for number in range(WARM):
            visit(number)
        tracemalloc.start()
        gc.collect()
        before, start = common.resident(daemon), time.perf_counter()
        last = WARM + rounds()
        for number in range(WARM, last):
            visit(number)
            if number % LOOK == 0:
                grown = (common.resident(daemon) - before) / 1e6
                python = tracemalloc.get_traced_memory()[0] / 1e3
                seconds = time.perf_counter() - start
                print(
                    f"    {number:8} {seconds:8.1f} s {grown:8.2f} MB {python:8.1f} kB", flush=True
                )
        gc.collect()
        report.figure("the daemon grew", (common.resident(daemon) - before) / 1e6, 8, "MB", False)
        python = tracemalloc.get_traced_memory()[0] / 1e3
        report.figure("Python grew", python, 300, "kB", False)
        nvisii.deinitialize()


if __name__ == "__main__":
    main()
