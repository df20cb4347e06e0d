"""R11: on SIGTERM, at any moment, readiness is gone within 100 ms while liveness stays, frames in
flight come or end with UNAVAILABLE and a retry time, and the daemon ends with 0 within 30 s; a
second SIGTERM ends it at once. A disk that hangs is left behind 8 s later, or then."""

import os
import pathlib
import random
import signal
import subprocess
import threading
import time

import common
import grpc
import heliograph as hg
import served
from health import Health

MOMENTS = ("starting", "loading", "rendering", "rendering for ever")


def main():
    random.seed(11)
    found = {"ready": [], "end": [], "codes": [], "wrong": 0, "dead": 0, "frames": 0, "cut": 0}
    with common.Report("R11 drain") as report:
        for trial in range(common.size(50, 4)):
            drain(MOMENTS[trial % len(MOMENTS)], found)
        report.figure("not ready after SIGTERM", 1e3 * max(found["ready"]), 100, "ms")
        report.figure("liveness lost before the end", found["dead"], 0, slack=False)
        report.figure("ended after", max(found["end"]), 30, "s", slack=False)
        report.figure("exit codes other than 0", sum(map(bool, found["codes"])), 0, slack=False)
        report.figure("frames that ended in another way", found["wrong"], 0, slack=False)
        print(f"  {found['frames']} frames came, {found['cut']} were cut off")
        report.figure("second SIGTERM: ended after", twice(), 2, "s")
        served.DAEMON = str(pathlib.Path(served.DAEMON).with_name("heliographd-faulty"))
        report.figure("a disk that hangs: ended after", hanging(75), 9, "s")
        report.figure("second SIGTERM at its end: ended after", hanging(0), 2, "s")
        with served.folder() as folder:
            took = twice(still_disk(folder), "--state-dir", folder / "state")
        report.figure("second SIGTERM before that: ended after", took, 2, "s")


def drain(moment, found):
    limit = "2" if moment == "rendering for ever" else "20"
    with served.served("--drain", limit) as daemon:
        work = [threading.Thread(target=load, args=(daemon, moment, found)) for _ in range(2)]
        health = Health(daemon.socket)
        watch = health.watch()
        if moment != "starting":
            health.wait(True)
            for thread in work:
                thread.start()
            time.sleep(random.uniform(0.2, 1.5))
        start = time.perf_counter()
        daemon.process.send_signal(signal.SIGTERM)
        if moment != "starting":  # it is not ready anyway, and nothing keeps it
            found["ready"].append(watch.first(False, after=start) - start)
            found["dead"] += not alive_until_the_end(daemon, health)
        found["codes"].append(daemon.process.wait(60))
        found["end"].append(time.perf_counter() - start)
        for thread in work:
            if thread.ident:
                thread.join()


def alive_until_the_end(daemon, health):
    try:
        return health.check("")
    except grpc.RpcError:
        return daemon.process.wait(5) == 0  # it had no work left


def load(daemon, moment, found):
    """Frames until the daemon ends; "loading" makes it build a large mesh for each of them."""
    with hg.connect(daemon.socket) as client:
        try:
            scene = common.stage(client)
            for frame in range(1_000_000):
                if moment == "loading":
                    with scene.edit() as edit:
                        ball = hg.shapes.sphere(0.5 + 0.001 * frame, segments=1000)
                        edit.entity("ball", mesh=edit.mesh("mesh", **ball))
                scene.render("cam", spp=1 << 20 if moment == "rendering for ever" else 8)
                found["frames"] += 1
        except hg.Unavailable as error:
            found["cut"] += 1
            found["wrong"] += not (error.retry_seconds > 0 or is_gone(daemon))
        except hg.HeliographError as error:
            print(f"  {moment}: {type(error).__name__}: {error}")
            found["wrong"] += 1


def is_gone(daemon):
    """Nobody is left who could have given a retry time."""
    try:
        daemon.process.wait(5)
    except subprocess.TimeoutExpired:
        return False
    return True


def still_disk(folder):
    """The file that makes the disk of heliographd-faulty hang while it is there."""
    os.environ["HELIOGRAPH_TEST_DISK"] = str(folder / "disk")
    return folder / "disk"


def edit_durable(daemon):
    with hg.connect(daemon.socket) as client:
        common.furnish(client.create_scene("room", lifetime="disk"), 64, 64)


def hanging(code):
    """Seconds from the last SIGTERM to the end, which has this code: 0 after a second one."""
    with served.folder() as folder:
        disk = still_disk(folder)
        daemon = served.Served(folder, "--state-dir", folder / "state")
        edit_durable(daemon)
        disk.touch()
        start = time.perf_counter()
        daemon.process.terminate()
        if code == 0:
            time.sleep(1)
            start = time.perf_counter()
            daemon.process.terminate()
        assert daemon.process.wait(60) == code
        return time.perf_counter() - start


def twice(disk=None, *flags):
    with served.served("--drain", "60", *flags) as daemon:
        if disk:
            edit_durable(daemon)
        health = Health(daemon.socket)
        health.wait(True)
        found = {"frames": 0, "cut": 0, "wrong": 0}
        thread = threading.Thread(target=load, args=(daemon, "rendering for ever", found))
        thread.start()
        time.sleep(1)
        if disk:
            disk.touch()
        daemon.process.terminate()
        health.wait(False)
        start = time.perf_counter()
        daemon.process.terminate()
        assert daemon.process.wait(30) == 0
        seconds = time.perf_counter() - start
        thread.join()
        return seconds


if __name__ == "__main__":
    main()
