"""R10: DEADLINE_EXCEEDED within 50 ms after the deadline, and the device is free by then; what has
expired in the queue is not started."""

import random
import threading
import time

import common
import heliograph as hg


def late(scene, deadline):
    """Seconds from the deadline to the error, and until no job is left."""
    start = time.perf_counter()
    try:
        scene.render("cam", spp=1 << 20, size=(640, 480), timeout=deadline)
    except hg.DeadlineExceeded:
        error = time.perf_counter() - start - deadline
    common.seconds_until(lambda: common.used(scene.client, "tenant_jobs") == 0)
    return error, time.perf_counter() - start - deadline


def main():
    random.seed(1)
    with common.Report("R10 deadlines") as report, common.daemon() as client:
        scene = common.stage(client, 640, 480)
        found = [late(scene, random.uniform(0.005, 0.5)) for _ in range(common.size(1000, 15))]
        error, free = zip(*found, strict=True)
        report.figure(
            "error after the deadline: p99", 1e3 * common.percentile(error, 0.99), 50, "ms"
        )
        report.figure("device free after it: p99", 1e3 * common.percentile(free, 0.99), 50, "ms")

        cancels = []
        holder = threading.Thread(target=occupy, args=(scene, cancels))
        holder.start()
        while not cancels:
            time.sleep(0.001)
        began = sum(starts(scene, 0.05) for _ in range(common.size(20, 3)))
        cancels[0]()
        holder.join()
        report.figure("frames of jobs that expired in the queue", began, 0)


def occupy(scene, cancels):
    """Has the device for itself: what comes later from the same session waits in line."""
    try:
        scene.render("cam", spp=1 << 20, size=(640, 480), on_start=cancels.append)
    except hg.Cancelled:
        pass


def starts(scene, deadline):
    frames = []
    try:
        scene.render("cam", spp=64, on_pass=frames.append, timeout=deadline)
    except hg.DeadlineExceeded:
        pass
    return len(frames)


if __name__ == "__main__":
    main()
