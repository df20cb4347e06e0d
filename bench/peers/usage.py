"""CPU time and peak memory of this process and all it started. Used by heliograph_peer.py."""

import glob
import os
import threading
import time

TICKS = os.sysconf("SC_CLK_TCK")


def children(pid):
    """Lists the ids of every living descendant of a process."""
    found = []
    for path in glob.glob(f"/proc/{pid}/task/*/children"):
        try:
            with open(path) as file:
                own = [int(word) for word in file.read().split()]
        except OSError:
            continue
        for child in own:
            found += [child, *children(child)]
    return found


def cpu_seconds(pid):
    """CPU time of a process, ended threads included; 0 when it is gone."""
    try:
        return time.clock_gettime((~pid << 3) | 2)  # clock_getcpuclockid(3)
    except OSError:
        return 0.0


def reaped_seconds(pid):
    """CPU time of its ended children, in steps of a clock tick."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            fields = file.read().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(fields[13]) + int(fields[14])) / TICKS


def peak_megabytes(pid):
    try:
        with open(f"/proc/{pid}/status") as file:
            return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1024
    except (OSError, StopIteration):
        return 0.0


class Tree:
    """CPU time and memory of this process and its descendants. A thread looks for those that live
    only a moment."""

    def __init__(self):
        self.peaks = {}
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self):
        while True:
            self._look()
            time.sleep(0.02)

    def _look(self):
        alive = [os.getpid(), *children(os.getpid())]
        for pid in alive:
            self.peaks[pid] = max(self.peaks.get(pid, 0.0), peak_megabytes(pid))
        return alive

    def usage(self):
        """(CPU seconds so far, sum of the peak memories in MB). Of the processes that have ended,
        which ran one after the other, the largest counts."""
        alive = self._look()
        cpu = sum(cpu_seconds(pid) + reaped_seconds(pid) for pid in alive)
        ended = [peak for pid, peak in self.peaks.items() if pid not in alive]
        return cpu, sum(self.peaks[pid] for pid in alive) + max(ended, default=0.0)
