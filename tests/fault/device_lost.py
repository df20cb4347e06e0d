"""R14, the host's half: a device that is lost is not ready within 5 s and made again within 10 s,
and gives the same image; one that hangs is not ready within 5 s, and is again when it moves.

The faults are injected into heliographd-faulty (faulty_daemon.cpp), which is beside heliographd.
"""

import os
import pathlib
import signal
import threading
import time

import common
import heliograph as hg
import numpy as np
from health import Health
from heliograph._wire.launch import find_program


def main():
    faulty = pathlib.Path(find_program()).with_name("heliographd-faulty")
    os.environ["HELIOGRAPHD"] = str(faulty)
    with common.Report("R14 lost and hanging devices") as report, common.daemon() as client:
        health = Health(client)
        scene = common.stage(client)
        planes = ["beauty", "depth", "instance"]
        before = scene.render("cam", spp=16, planes=planes)
        health.wait(True)
        worst = {"gone": 0.0, "back": 0.0}
        different = 0
        for _ in range(common.size(50, 3)):
            gone, back = lose(client, scene, health)
            worst = {"gone": max(worst["gone"], gone), "back": max(worst["back"], back)}
            after = scene.render("cam", spp=16, planes=planes)
            different += not all(np.array_equal(before[p], after[p]) for p in planes)
        report.figure("lost: not ready after", worst["gone"], 5, "s", slack=False)
        report.figure("lost: ready again after", worst["back"], 10, "s", slack=False)
        report.figure("images that differ from the one before", different, 0, slack=False)
        hanging(client, scene, health, report)


def lose(client, scene, health):
    """Seconds until readiness is gone, and until it is back; a job that runs ends with it."""
    errors = []
    job = threading.Thread(target=endless, args=(scene, errors))
    job.start()
    time.sleep(0.1)
    watch = health.watch()
    start = time.perf_counter()
    os.kill(common.pid_of(client), signal.SIGUSR1)
    job.join()
    assert isinstance(errors[0], hg.Unavailable), errors
    assert errors[0].retry_seconds > 0
    gone = watch.first(False, after=start)
    back = watch.first(True, after=gone)
    watch.close()
    return gone - start, back - start


def endless(scene, errors):
    try:
        scene.render("cam", spp=1 << 20)
    except hg.HeliographError as error:
        errors.append(error)


def hanging(client, scene, health, report):
    frames = []
    waiting = threading.Thread(target=lambda: frames.append(scene.render("cam", spp=16)))
    os.kill(common.pid_of(client), signal.SIGUSR2)
    start = time.perf_counter()
    waiting.start()
    health.wait(False)
    report.figure("hanging: not ready after", time.perf_counter() - start, 5, "s", slack=False)
    reason = client.info().not_ready
    assert "device" in reason or "pixel" in reason, reason
    report.figure("hanging: liveness lost", int(not health.check("")), 0, slack=False)
    os.kill(common.pid_of(client), signal.SIGUSR2)
    start = time.perf_counter()
    health.wait(True)
    report.figure("moving again: ready after", time.perf_counter() - start, 5, "s", slack=False)
    waiting.join()
    report.figure("frames that the hang cost", 1 - len(frames), 0, slack=False)


if __name__ == "__main__":
    main()
