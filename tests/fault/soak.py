"""R18: mixed load with clients that crash, for as long as wanted: no restart, no growth.

usage: .venv/bin/python tests/fault/soak.py [--short] [MINUTES=420]
Prints a line a minute; the slope is over the last two thirds.
"""

import random
import sys
import time

import common
import load
import numpy as np

CLIENTS = common.size(6, 3)


def minutes():
    given = [word for word in sys.argv[1:] if not word.startswith("-")]
    return float(given[0]) if given else common.size(420, 0.1)


def attend(crowd, dice):
    """Keeps CLIENTS at work; half of them crash."""
    while crowd.reap() < CLIENTS:
        crowd.start(dice.uniform(0.5, 8), killed=dice.random() < 0.5)
    time.sleep(0.02)


def slope(times, sizes):
    """MB an hour, by least squares over the last two thirds."""
    first = len(times) // 3
    return float(np.polyfit(times[first:], sizes[first:], 1)[0]) * 3600


def main():
    seconds, dice = 60 * minutes(), random.Random(1)
    with common.Report(f"R18 soak, {seconds / 60:g} min") as report:
        with common.daemon("--grace", "1") as client:
            crowd, pid = load.Crowd(client.address), common.pid_of(client)
            load.visit(client.address, 0, 0.5, killed=False)
            common.clear_device(client)
            baseline = load.holdings(client)
            start, times, sizes = time.perf_counter(), [], []
            while (now := time.perf_counter() - start) < seconds:
                attend(crowd, dice)
                if now - (times[-1] if times else 0) >= min(10, seconds / 20):
                    times.append(now)
                    sizes.append(common.resident(pid) / 1e6)
                    if len(times) % 6 == 0:
                        shown = f"{now / 60:6.1f} min {sizes[-1]:8.1f} MB {crowd.ended} clients"
                        print(f"    {shown}, {crowd.failed} failed", flush=True)
            while crowd.reap():
                time.sleep(0.05)
            common.clear_device(client)
            common.seconds_until(lambda: load.holdings(client)["scenes"] == 0)
            time.sleep(2)
            left = load.holdings(client)
            report.figure(f"of {crowd.ended} clients failed", crowd.failed, 0, slack=False)
            for name in ("scenes", "fds", "memfds", "threads"):
                grown = left[name] - baseline[name]
                report.figure(f"{name} left", grown, load.ROOM.get(name, 0), slack=False)
            if seconds >= 1800:
                report.figure("slope of memory", slope(times, sizes), 1, "MB/h", slack=False)
            else:
                print(f"  memory {sizes[0]:.1f} to {sizes[-1]:.1f} MB: too short for a slope")
            died = client.connection.daemon.exit_code() is not None
            report.figure("restarts", died, 0, slack=False)


if __name__ == "__main__":
    main()
