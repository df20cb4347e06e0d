"""R18: mixed load with clients that crash, for as long as wanted: no restart, no growth.

usage: .venv/bin/python tests/fault/soak.py [--short] [MINUTES=420]
Memory is looked at when nobody is there: under load it shows what is just being done. The slope is
over the last two thirds, and accepted when a growth of 1 MB/h lies within two of its errors.
"""

import random
import sys
import time

import common
import load
import numpy as np

CLIENTS = common.size(6, 3)
BETWEEN = common.size(120, 2)  # seconds of load from one look at memory to the next
SETTLES = common.size(4, 1)  # seconds until the heap gave freed pages back


def minutes():
    given = [word for word in sys.argv[1:] if not word.startswith("-")]
    return float(given[0]) if given else common.size(420, 0.1)


def work(crowd, dice, until):
    """Keeps CLIENTS at work, half of them crash; then waits for the last to end."""
    while time.perf_counter() < until:
        while crowd.reap() < CLIENTS:
            crowd.start(dice.uniform(0.5, 8), killed=dice.random() < 0.5)
        time.sleep(0.02)
    while crowd.reap():
        time.sleep(0.05)


def rest(client, baseline):
    """Bytes that the daemon has when its clients and what they had are gone."""

    def gone():
        found = load.holdings(client)
        return all(found[name] <= baseline[name] for name in ("scenes", "tenant_entities"))

    common.seconds_until(gone)
    common.clear_device(client)
    time.sleep(SETTLES)
    return common.resident(common.pid_of(client))


def slope(times, sizes):
    """MB an hour, by least squares over the last two thirds, and its standard error."""
    first = len(times) // 3
    fit, spread = np.polyfit(times[first:], sizes[first:], 1, cov=True)
    return float(fit[0]) * 3600, float(spread[0, 0]) ** 0.5 * 3600


def report_memory(report, times, sizes):
    if times[-1] < 1500:
        print(f"  memory {sizes[0]:.1f} to {sizes[-1]:.1f} MB: too short for a slope")
        return
    growth, error = slope(times, sizes)
    print(f"  slope of memory at rest: {growth:.2f} +- {error:.2f} MB/h, {len(times)} looks")
    report.figure("slope less two errors", growth - 2 * error, 1, "MB/h", slack=False)


def main():
    seconds, dice = 60 * minutes(), random.Random(1)
    with common.Report(f"R18 soak, {seconds / 60:g} min") as report:
        with common.daemon("--grace", "1") as client:
            crowd, times, sizes = load.Crowd(client.address), [], []
            load.visit(client.address, 0, 0.5, killed=False)
            common.clear_device(client)
            baseline = load.holdings(client)
            start = time.perf_counter()
            while (now := time.perf_counter() - start) < seconds:
                work(crowd, dice, start + min(now + BETWEEN, seconds))
                sizes.append(rest(client, baseline) / 1e6)
                times.append(time.perf_counter() - start)
                shown = f"{times[-1] / 60:6.1f} min {sizes[-1]:8.1f} MB {crowd.ended} clients"
                print(f"    {shown}, {crowd.failed} failed", flush=True)
            left = load.holdings(client)
            report.figure(f"of {crowd.ended} clients failed", crowd.failed, 0, slack=False)
            for name in ("scenes", "fds", "memfds", "threads"):
                grown = left[name] - baseline[name]
                report.figure(f"{name} left", grown, load.ROOM.get(name, 0), slack=False)
            report_memory(report, times, sizes)
            died = client.connection.daemon.exit_code() is not None
            report.figure("restarts", died, 0, slack=False)


if __name__ == "__main__":
    main()
