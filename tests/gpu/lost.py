"""R14 and R9 on the GPU: a lost context is made again and gives the same image; a cancelled call
frees the GPU.

usage: .venv/bin/python tests/gpu/lost.py   (needs an NVIDIA GPU; 80 s)
HELIOGRAPHD names the daemon; beside it is heliographd-faulty, from build/cuda/bin. That lets a
program read where there is no memory, so that the driver gives the context up as it does after any
such fault. Prints its figures beside what is promised; ends with 1 when one was missed.
"""

import gc
import logging
import os
import pathlib
import subprocess
import sys

import heliograph as hg
import numpy as np
from heliograph._launch import find_program

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "fault"))
import cancel_storm
import common
import device_lost
from health import Health

LOSSES, CANCELS, DEATHS = 8, 120, 10
PICTURE = {"planes": ["beauty", "depth", "instance"], "spp": 16, "progress": False}
GROWN_MIB = 64  # by all losses together: what the driver keeps of a context


def gpu_mib():
    ask = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return sum(int(line) for line in subprocess.check_output(ask, text=True).split())


def differ(frame, before):
    return not all(np.array_equal(frame[plane], before[plane]) for plane in PICTURE["planes"])


def losses(report):
    with common.daemon("--backend", "cuda", "--log-level", "info") as client:
        health = Health(client)
        scene = common.stage(client, 640, 480)
        before = scene.render("cam", **PICTURE)
        kept = scene.render("cam", device="cuda", **PICTURE)  # over the first loss
        health.wait(True)
        gone, back, wrong, used = [], [], 0, []
        for k in range(LOSSES):
            lost = device_lost.lose(client, scene, health)
            gone.append(lost[0])
            back.append(lost[1])
            wrong += differ(scene.render("cam", **PICTURE), before)
            if k == 0:
                del kept
                gc.collect()
            on_gpu = scene.render("cam", device="cuda", **PICTURE)
            del on_gpu
            used.append(gpu_mib())
            print(f"  loss {k}: gone {gone[-1]:.2f} s, back {back[-1]:.2f} s, {used[-1]} MiB")
        report.figure("lost: not ready after", max(gone), 5, "s", slack=False)
        report.figure("lost: ready again after", max(back), 10, "s", slack=False)
        report.figure("images that differ from the one before", wrong, 0, slack=False)
        report.figure("memory that losses cost", used[-1] - used[1], GROWN_MIB, "MiB", slack=False)
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
        try:
            losses(report)
        except (hg.HeliographError, TimeoutError) as error:
            print(f"  the daemon did not come back: {error}")
            report.failed = True
        os.environ["HELIOGRAPHD"] = plain
        cancels(report)


if __name__ == "__main__":
    main()
