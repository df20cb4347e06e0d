"""Fairness: 16 clients together do at least 95 % of what one does, each within 1.5 times its fair
share's time; and R17: beside a tenant that asks for ten times its share, another one's p99 is at
most 1.5 times what it is alone."""

import concurrent.futures
import contextlib
import threading
import time

import common
import heliograph as hg
import served

SPP = common.size(16, 2)
CLIENTS = 16


def work(scene, until):
    """Seconds of each job until a time."""
    took = []
    while time.perf_counter() < until:
        start = time.perf_counter()
        scene.render("cam", spp=SPP)
        took.append(time.perf_counter() - start)
    return took


def together(scenes, seconds):
    """(jobs a second, seconds of each job) of all at once."""
    start = time.perf_counter()
    with concurrent.futures.ThreadPoolExecutor(len(scenes)) as pool:
        found = list(pool.map(lambda scene: work(scene, start + seconds), scenes))
    took = [seconds for each in found for seconds in each]
    return len(took) / (time.perf_counter() - start), took


def now_and_then(scene, seconds, every):
    """Seconds of a small job every now and then."""
    took, until = [], time.perf_counter() + seconds
    while time.perf_counter() < until:
        start = time.perf_counter()
        scene.render("cam", spp=4)
        took.append(time.perf_counter() - start)
        time.sleep(max(0.0, every - took[-1]))
    return took


def noise(scene):
    """Ten jobs at a time, until it is closed."""
    return scene.render_batch((hg.Job("cam", spp=256) for _ in range(1_000_000)), credits=10)


def drain(results):
    with contextlib.suppress(hg.Cancelled):
        for _ in results:
            pass


def sixteen(scenes, seconds, report):
    """In turns, because other work of the machine comes and goes."""
    losses, late = [], []
    for _ in range(3):
        one, alone = together(scenes[:1], seconds)
        rate, took = together(scenes, seconds)
        losses.append(100 * (1 - rate / one))
        fair = CLIENTS * common.percentile(alone, 0.5)
        late.append(common.percentile(took, 0.99) / fair)
    report.figure("throughput lost by 16 clients", common.percentile(losses, 0.5), 5, "%")
    report.figure("p99 over fair share's time", common.percentile(late, 0.5), 1.5)


def noisy(scene, neighbour, seconds, report):
    """One asks for a quarter of the device: less than its half. The scenes are two tenants'."""
    quiet, loud = [], []
    every = 4 * common.percentile(now_and_then(scene, 1, 0), 0.5)
    for _ in range(3):
        quiet += now_and_then(scene, seconds, every)
        results = noise(neighbour)
        thread = threading.Thread(target=drain, args=(results,))
        thread.start()
        time.sleep(1)
        loud += now_and_then(scene, seconds, every)
        results.close()
        thread.join()
    for share in (0.5, 0.99):
        ratio = common.percentile(loud, share) / common.percentile(quiet, share)
        report.figure(f"R17: {100 * share:g} % beside noise over alone", ratio, 1.5)


def main():
    seconds = common.size(10, 1)
    with common.Report("fairness") as report:
        with common.daemon() as client:
            clients = [hg.connect(client.address) for _ in range(CLIENTS)]
            sixteen([common.stage(each) for each in clients], seconds, report)
            for each in clients:
                each.close()
        with served.folder() as place, contextlib.ExitStack() as stack:
            daemon = stack.enter_context(served.served("--tenants", served.tenants_file(place)))
            scenes = [
                common.stage(stack.enter_context(hg.connect(daemon.socket, token=token)))
                for token in served.TOKENS.values()
            ]
            noisy(*scenes, seconds, report)


if __name__ == "__main__":
    main()
