"""R9: a cancelled call, or the death of its client, frees the device within 50 ms."""

import contextlib
import random
import threading
import time

import common
import heliograph as hg


def calls(scene):
    """name -> start() that begins a call which takes long, and gives what cancels it."""
    endless = {"spp": 1 << 20, "size": (640, 480)}

    def in_thread(run, cancels):
        def quiet():
            with contextlib.suppress(hg.HeliographError):
                run()

        thread = threading.Thread(target=quiet)
        thread.start()
        while not cancels:
            time.sleep(0.0005)
        return lambda: (cancels[0](), thread.join())

    def render():
        cancels = []
        return in_thread(lambda: scene.render("cam", on_start=cancels.append, **endless), cancels)

    def batch():
        results = scene.render_batch([hg.Job("cam", **endless) for _ in range(4)])
        return in_thread(lambda: list(results), [results.close])

    def stream():
        live = scene.stream("cam", **endless)
        return in_thread(lambda: list(live), [live.close])

    return {"Render": render, "RenderBatch": batch, "Stream": stream}


def storm(client, start, count):
    """Seconds from each cancel until no job is left."""
    took = []
    for _ in range(count):
        cancel = start()
        time.sleep(random.random() * 0.05)
        begin = time.perf_counter()
        cancel()
        common.seconds_until(lambda: common.used(client, "tenant_jobs") == 0)
        took.append(time.perf_counter() - begin)
    return took


def deaths(client, count):
    """The same for sessions that end with their calls."""
    took = []
    for _ in range(count):
        other = hg.connect(client.address)
        scene = common.stage(other, 640, 480)
        lives = [scene.stream("cam", spp=1 << 20) for _ in range(2)]
        for live in lives:
            next(live)
        begin = time.perf_counter()
        other.close()
        common.seconds_until(lambda: common.used(client, "tenant_jobs") == 0)
        took.append(time.perf_counter() - begin)
    return took


def main():
    random.seed(1)
    with common.Report("R9 cancel") as report, common.daemon("--grace", "0") as client:
        scene = common.stage(client, 640, 480)
        for name, start in calls(scene).items():
            took = storm(client, start, common.size(330, 10))
            report.figure(
                f"{name}: p99 until the device is free",
                1e3 * common.percentile(took, 0.99),
                50,
                "ms",
            )
        took = deaths(client, common.size(50, 3))
        report.figure("end of session: p99", 1e3 * common.percentile(took, 0.99), 50, "ms")
        report.figure("jobs left", common.used(client, "tenant_jobs"), 0)
        left = common.seconds_until(lambda: common.used(client, "tenant_streams") == 0)
        report.figure("until no stream is left", left, 1, "s")


if __name__ == "__main__":
    main()
