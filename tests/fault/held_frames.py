"""A client keeps 100,000 small frames, of the smallest size that travels in shared memory, while
others connect and render, under deploy's limit of descriptors: they lie in a few descriptors and
mappings, here and in the daemon, cost little beside their pixels, and go when the client lets go of
them."""

import gc
import os
import time

import common
import heliograph as hg
import numpy as np
from health import Health
from served import few_descriptors, served

DESCRIPTORS = 8192  # of deploy/heliographd.service
FRAMES = common.size(100_000, 2_500)
SIZE = (128, 128)  # a plane of 64 KiB
PIXELS = SIZE[0] * SIZE[1] * 4
AT_ONCE = 50  # of one call
ROOM = 16 << 30
OPTIONS = {"planes": ["depth"], "labels": False, "progress": False, "size": SIZE}


def mappings():
    with open("/proc/self/maps") as lines:
        return sum(1 for _ in lines)


def look(scene):
    return scene.render("cam", **OPTIONS)


def changed(held, sample):
    """How many of the frames that are held are not the picture they were."""
    return sum(not np.array_equal(frame["depth"], sample, equal_nan=True) for frame in held)


def neighbour(daemon, count):
    """Seconds of the slowest of a neighbour's frames, and of connecting anew."""
    slowest = 0.0
    for _ in range(count):
        start = time.perf_counter()
        with hg.connect(daemon.socket) as other:
            look(common.stage(other, *SIZE))
        slowest = max(slowest, time.perf_counter() - start)
    return slowest


def hold(scene, report):
    start = time.perf_counter()
    held = []
    while len(held) < FRAMES:
        held += scene.render(["cam"] * AT_ONCE, **OPTIONS)
    seconds = time.perf_counter() - start
    print(f"  {FRAMES} frames of {PIXELS >> 10} KiB held: {FRAMES / seconds:.0f} a second")
    shared = scene.client.connection.link.shared
    report.figure("frames that came as bytes", FRAMES - len(shared._leases), 0, slack=False)
    return held


def main():
    flags = [f"--limit={name}={ROOM}" for name in ("shared_bytes", "tenant_bytes")]
    with (
        common.Report("frames that are held") as report,
        served(*flags, under=few_descriptors(DESCRIPTORS)) as daemon,
        hg.connect(daemon.socket) as client,
    ):
        health = Health(client)
        health.wait(True)
        scene = common.stage(client, *SIZE)
        sample = look(scene)["depth"].copy()
        before = daemon.descriptors(), len(os.listdir("/proc/self/fd")), mappings()
        used = common.used(client, "tenant_bytes")
        held = hold(scene, report)
        now = daemon.descriptors(), len(os.listdir("/proc/self/fd")), mappings()
        few = 20 + (FRAMES * PIXELS >> 25)  # an arena has 64 MiB; the first ones less
        report.figure("descriptors of the daemon for them", now[0] - before[0], few, slack=False)
        report.figure("descriptors of the client", now[1] - before[1], few, slack=False)
        report.figure("mappings of the client", now[2] - before[2], few + 200, slack=False)
        charged = (common.used(client, "tenant_bytes") - used) / FRAMES
        report.figure("bytes charged a frame", charged, PIXELS + 4096, "B", slack=False)
        slowest = neighbour(daemon, common.size(20, 2))
        report.figure("another connects and renders within", slowest, 2, "s")
        report.figure("not live", int(not health.check("")), 0, slack=False)
        report.figure("not ready", int(not health.check()), 0, slack=False)
        report.figure("frames that changed", changed(held, sample), 0, slack=False)
        del held
        gc.collect()
        most = used + (256 << 20)  # what a client keeps for its next frames
        look(scene)
        seconds = common.seconds_until(lambda: common.used(client, "tenant_bytes") <= most)
        report.figure("let go of: their memory is back within", seconds, 5, "s")
        common.seconds_until(lambda: daemon.descriptors() <= before[0] + 12)


if __name__ == "__main__":
    main()
