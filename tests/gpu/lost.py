"""R14 and R9 on the GPU: after a fault the daemon makes another context, or saves its scenes, ends
with 75 and goes on where it is started again, with the same images; a cancelled call frees the GPU.

usage: .venv/bin/python tests/gpu/lost.py   (needs an NVIDIA GPU; 80 s)
HELIOGRAPHD names the daemon; beside it is heliographd-faulty, from build/cuda/bin. That lets a
program read where there is no memory, so that the driver gives the context up as it does after any
such fault. Prints its figures beside what is promised; ends with 1 when one was missed.
"""

import contextlib
import gc
import logging
import os
import pathlib
import signal
import subprocess
import sys
import time

import grpc
import heliograph as hg
import numpy as np
from heliograph._wire.launch import find_program

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "fault"))
import cancel_storm
import common
import device_lost
import saved_scenes
import served
from health import Health
from saved_scenes import PICTURE, differ

LOSSES, CANCELS, DEATHS = 8, 120, 10
GROWN_MIB = 64  # by all losses together: what the driver keeps of a context


def gpu_mib():
    ask = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return sum(int(line) for line in subprocess.check_output(ask, text=True).split())


def lose(daemon, scene, report):
    """Plants the fault; true if the daemon has to be started again, as most drivers want it."""
    health = Health(f"unix:{daemon.path}")
    with contextlib.suppress(hg.Unavailable):
        os.kill(daemon.pid, signal.SIGUSR1)
        scene.render("cam", spp=1 << 20, progress=False)
    begun, ended = time.perf_counter(), None
    while ended is None and time.perf_counter() - begun < 30:
        ended = daemon.process.poll()
        with contextlib.suppress(grpc.RpcError):
            if ended is None and time.perf_counter() - begun > 3 and health.check(timeout=1):
                return False
        time.sleep(0.02)
    report.figure("lost: ended after", time.perf_counter() - begun, 5, "s", slack=False)
    report.figure("exit code that is not 75", abs((ended or 0) - 75), 0, slack=False)
    return True


def losses(report, folder):
    daemon = saved_scenes.start(folder, "--backend", "cuda")
    with hg.connect(daemon.socket) as client:
        scene = common.stage(client, 640, 480)  # a private one
        before = scene.render("cam", **PICTURE)
        wrong, used, back = 0, [], [0.0]
        for k in range(LOSSES):
            if lose(daemon, scene, report):
                begun = time.perf_counter()
                daemon = saved_scenes.start(folder, "--backend", "cuda")
                Health(f"unix:{daemon.path}").wait(True)
                back.append(time.perf_counter() - begun)
            else:
                print("  the driver made another context in the same process")
            with scene.edit() as edit:
                edit.entity(transform=hg.Pose((k, 0, 0)))
            wrong += edit.revision != 2 + k
            wrong += differ(scene.render("cam", **PICTURE), before)
            on_gpu = scene.render("cam", device="cuda", **PICTURE)
            del on_gpu
            gc.collect()
            used.append(gpu_mib())
            print(f"  loss {k}: back {back[-1]:.2f} s, {used[-1]} MiB")
        report.figure("lost: ready again after", max(back), 10, "s", slack=False)
        report.figure("edits and images that differ", wrong, 0, slack=False)
        report.figure("memory that losses cost", used[-1] - used[0], GROWN_MIB, "MiB", slack=False)
    daemon.stop()
    report.figure("left in the state directory", saved_scenes.left(folder), 0, slack=False)
    for line in daemon.log().splitlines():
        print(f"  {line}")


def hanging(report):
    with common.daemon("--backend", "cuda") as client:
        scene = common.stage(client, 640, 480)
        before = scene.render("cam", **PICTURE)
        health = Health(client)
        health.wait(True)
        device_lost.hanging(client, scene, health, report)
        report.figure("after all", differ(scene.render("cam", **PICTURE), before), 0, slack=False)


def cancels(report):
    with common.daemon("--backend", "cuda", "--grace", "0") as client:
        scene = common.stage(client, 640, 480)
        for name, start in cancel_storm.calls(scene).items():
            took = 1e3 * np.array(cancel_storm.storm(client, start, CANCELS))
            print(f"  {name}: median {np.median(took):.1f} ms, worst {took.max():.1f} ms")
            p99 = common.percentile(took, 0.99)
            report.figure(f"{name}: p99 until the GPU is free", p99, 50, "ms", slack=False)
        took = 1e3 * np.array(cancel_storm.deaths(client, DEATHS))
        report.figure("end of session: worst", took.max(), 50, "ms", slack=False)
        report.figure("jobs left", common.used(client, "tenant_jobs"), 0, slack=False)


def main():
    logging.basicConfig(level=logging.INFO, format="  %(message)s")
    plain = find_program()
    faulty = pathlib.Path(plain).with_name("heliographd-faulty")
    if not faulty.exists():
        sys.exit(f"{faulty} is not here: copy it from the build tree's bin")
    with common.Report("R14 a lost GPU, R9 cancelled calls") as report:
        os.environ["HELIOGRAPHD"] = str(faulty)
        served.DAEMON = str(faulty)
        try:
            with served.folder() as folder:
                losses(report, folder)
        except (hg.HeliographError, TimeoutError) as error:
            print(f"  the daemon did not come back: {error}")
            report.failed = True
        hanging(report)
        os.environ["HELIOGRAPHD"] = plain
        cancels(report)


if __name__ == "__main__":
    main()
