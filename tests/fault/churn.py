"""R7: clients that connect, work and vanish, half of them by kill -9, leave nothing behind."""

import sys
import time

import common
import load

TOGETHER = 8  # processes at a time: more only wait for the cores


def come_and_go(crowd, clients):
    """One round: each works for a moment, every other one dies of it."""
    for i in range(clients):
        while crowd.reap() >= TOGETHER:
            time.sleep(0.005)
        crowd.start(0, killed=i % 2 == 1)
    while crowd.reap():
        time.sleep(0.005)


def settled(client, baseline):
    """Seconds until everything is back where it was; what is not, when it takes too long."""
    above = {}

    def back():
        found = load.holdings(client)
        above.clear()
        over = {name: count - baseline[name] for name, count in found.items()}
        above.update({k: v for k, v in over.items() if v > load.ROOM.get(k, 0)})
        return not above

    try:
        return common.seconds_until(back, 20), {}
    except TimeoutError:
        return 20.0, above


def main():
    clients, rounds = common.size(200, 4), common.size(50, 4)
    with common.Report("R7 churn") as report, common.daemon("--grace", "0") as client:
        crowd = load.Crowd(client.address)
        come_and_go(crowd, clients)  # pools and caches fill
        common.clear_device(client)
        time.sleep(0.5)
        baseline, sizes, slowest, left = load.holdings(client), [], 0.0, {}
        for number in range(rounds):
            come_and_go(crowd, clients)
            common.clear_device(client)
            seconds, above = settled(client, baseline)
            slowest, left = max(slowest, seconds), {**left, **above}
            sizes.append(common.resident(common.pid_of(client)) / 1e6)
            if not common.SHORT:
                print(f"    round {number + 1}: {sizes[-1]:.1f} MB", flush=True)
        print(f"  {crowd.ended} clients; at rest the daemon has {baseline}")
        report.figure("clients that failed", crowd.failed, 0, slack=False)
        report.figure("until all is back", slowest, 5, "s")
        for name in baseline:
            report.figure(f"{name} left", left.get(name, 0), load.ROOM.get(name, 0), slack=False)
        # The short form sees the daemon's memory settle; only the long one sees it settled.
        grown, most = sizes[-1] - sizes[len(sizes) // 2 - 1], common.size(5, 30)
        report.figure("growth of memory in the 2nd half", grown, most, "MB", slack=False)
        died = client.connection.daemon.exit_code() is not None
        report.figure("crashes", died, 0, slack=False)


if __name__ == "__main__":
    sys.exit(main())
