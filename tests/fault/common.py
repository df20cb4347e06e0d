"""Helpers of this folder's scripts. Each prints its figure beside what is promised, and ends
with 1 when it was missed.

usage: .venv/bin/python tests/fault/NAME.py [--short]   --short: seconds, few trials, and times may
be ten times over, because other work may share the machine. HELIOGRAPHD names the daemon.
"""

from __future__ import annotations

import contextlib
import pathlib
import sys
import time

import heliograph as hg
import numpy as np

SHORT = "--short" in sys.argv
SLACK = 10 if SHORT else 1


def size(long, short):
    """How many trials, or how long."""
    return short if SHORT else long


@contextlib.contextmanager
def daemon(*arguments, **limits):
    """A client of a private daemon with these limits."""
    flags = [flag for name, value in limits.items() for flag in ("--limit", f"{name}={value}")]
    with hg.connect(arguments=[*flags, *arguments]) as client:
        yield client


def furnish(scene, width, height):
    """A ball under the bundled studio, seen by "cam"."""
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
        edit.entity("ball", mesh=mesh, transform=hg.Pose((0, 0, 0.5)), label="auto")
        lens = hg.Camera.from_fov(50, width, height, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))


def stage(client, width=256, height=256, **options):
    """A ball under the bundled studio, seen by "cam"; its derived data is made."""
    scene = client.create_scene(**options)
    furnish(scene, width, height)
    scene.render("cam", planes=["depth"])
    return scene


def clear_device(client):
    """The device keeps the scenes that it showed last: shows others until the rest is gone."""
    with client.create_scene() as scene:
        for x in range(10):
            with scene.edit() as edit:
                lens = hg.Camera.from_fov(50, 8, 8, degrees=True)
                edit.entity("cam", camera=lens, transform=hg.Pose((x, 0, 0)))
            scene.render("cam", planes=["depth"], labels=False)


def pid_of(client):
    """The process of a private daemon."""
    return client.connection.daemon._process.pid


def resident(pid, key="VmRSS"):
    """Bytes that a process has; with the key VmHWM the most that it had."""
    for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1]) << 10
    raise ProcessLookupError(pid)


def peak(pid):
    """Bytes that a process had at most."""
    return resident(pid, "VmHWM")


def used(client, name):
    """Use of a limit by the tenant."""
    return client.info().used[name]


def seconds_until(condition, limit=30.0):
    """How long it takes until condition() holds."""
    start = time.perf_counter()
    while not condition():
        if time.perf_counter() - start > limit:
            raise TimeoutError("did not come true")
        time.sleep(0.001)
    return time.perf_counter() - start


def percentile(seconds, share):
    return float(np.quantile(seconds, share))


class Report:
    """Collects figures; `with Report("...") as report:` exits with 1 when one was missed."""

    def __init__(self, title):
        self.failed = False
        print(title, "(short)" if SHORT else "")

    def figure(self, name, value, promise, unit="", slack=True):
        """value against the most that is promised; with `slack` a --short run allows more."""
        good = value <= promise * (SLACK if slack else 1)
        self.failed |= not good
        print(
            f"  {name:44} {value:10.4g} {unit:4} promised <= {promise:g} {unit}"
            f"{'' if good else '  MISSED'}",
            flush=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if kind is None:
            sys.exit(1 if self.failed else 0)
