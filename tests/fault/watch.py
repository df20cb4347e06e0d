"""R5: watchers of scenes that several clients edit, under kill -9, drains, slow readers and
compaction: each event once, whole, in order, none left out; bookmarks and resuming hold; and what a
watcher that reads nothing costs.

usage: watch.py [RUNS=100 [SECONDS=60]]   or --short
"""

import sys
import tempfile
import threading
import time

import common
import heliograph as hg
import numpy as np
from crash_loop import at
from heliograph._wire._proto import scene_pb2 as pb
from heliograph._wire._proto import service_pb2 as service
from served import Served
from worker import Worker

NUMBERS = [int(a) for a in sys.argv[1:] if a.isdigit()]
RUNS = (NUMBERS + [common.size(100, 1)])[0]
SECONDS = (NUMBERS[1:] + [common.size(60, 3)])[0]
EDITORS = 3
PAUSE = 0.008  # seconds between an editor's edits
KEPT = 64  # events where they are compacted: those of about 200 ms
EVENT, READERS = 1 << 20, 20  # bytes of an event, watchers that read nothing


class Client(Worker):
    """A client with a thread."""

    def __init__(self, address):
        self.client = hg.connect(address)
        self.scene = self.client.open_scene("room")
        super().__init__()

    def close(self):
        self.client.close()


class Editor(Client):
    """Puts two entities of its own at the same place, again and again."""

    def __init__(self, address, number):
        self.number, self.acknowledged = number, {}  # revision -> transaction
        super().__init__(address)

    def run(self):
        count = 0
        while not self.stopping.is_set():
            count += 1
            transaction = pb.Transaction()
            for name in "ab":
                edit = transaction.edits.add()
                edit.target.name = f"{self.number}.{name}"
                edit.entity.pose.matrices.CopyFrom(at(count))
            self.acknowledged[self.scene.apply(transaction).revision] = transaction
            time.sleep(PAUSE)


class Watcher(Client):
    """Reads events and checks what can be seen of them here."""

    slowness = 0.0  # seconds for each event
    rounds = None  # events after which it begins anew where it was

    def __init__(self, address, until):
        self.seen = {}  # revision -> transaction
        self.until = until  # () -> the revision that is the last one, or None
        self.compacted = self.twice = self.disordered = self.missing = self.bookmarks = 0
        self.wrong_bookmarks = 0
        super().__init__(address)

    def run(self):
        first = 1
        while not self.is_over(first - 1):
            try:
                with self.scene.watch(first, bookmark_seconds=0.5) as watch:
                    self.wrong_bookmarks += watch.revision != first - 1
                    first = self.read(watch, first)
            except hg.OutOfRange as error:
                if error.expected <= first:
                    raise
                self.compacted += 1
                first = error.expected

    def is_over(self, revision):
        return self.until() is not None and revision >= self.until()

    def read(self, watch, first):
        """The revision to go on from, when it is over or ends its round."""
        count = 0
        try:
            for change in watch:
                self.note(change, first)
                first = change.revision + 1
                count += not change.is_bookmark
                if self.is_over(change.revision) or count == self.rounds:
                    return first
                time.sleep(self.slowness if not self.stopping.is_set() else 0)
        except hg.OutOfRange as error:
            self.missing += error.expected <= first  # it could have had the next one
            self.compacted += 1
            return error.expected
        raise AssertionError("the iteration ended by itself")

    def note(self, change, first):
        if change.is_bookmark:
            self.bookmarks += 1
            self.wrong_bookmarks += change.revision != first - 1
            return
        self.twice += change.revision in self.seen
        self.disordered += change.revision < first
        self.missing += change.revision > first
        self.seen[change.revision] = change.transaction


class Slow(Watcher):
    slowness = 0.05


class Resuming(Watcher):
    rounds = 7


def run(folder, seconds, kept, counts):
    """Edits and kills; then all watchers read to the end. Adds to counts."""
    flags = ["--state-dir", f"{folder}/state", "--limit", "snapshot_edits=300"]
    flags += ["--limit", f"watch_events={kept}"] if kept else []
    daemon = Served(folder, *flags)
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="disk")
        last = []
        kinds = [Watcher, Watcher, Resuming, *([Slow] if kept else [])]
        watchers = [kind(daemon.socket, lambda: last[0] if last else None) for kind in kinds]
        editors = [Editor(daemon.socket, number) for number in range(EDITORS)]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(1.0)
            daemon.process.kill() if counts["kills"] % 3 < 2 else daemon.process.terminate()
            daemon.process.wait(30)
            counts["kills"] += 1
            daemon = Served(folder, *flags)
        time.sleep(1.0)  # bookmarks
        for editor in editors:
            editor.stop()
        common.seconds_until(lambda: any(w.bookmarks for w in watchers))  # the scene is idle
        last.append(scene.revision)
        with scene.edit() as edit:  # wakes those who wait
            edit.entity("end")
        for watcher in watchers:
            watcher.stop()
        check(editors, watchers, last[0], counts)
        counts["told nothing of what is compacted"] += kept and not refuses_old(scene)
        for worker in (*editors, *watchers):
            worker.close()
    daemon.stop()


def check(editors, watchers, last, counts):
    """Compares the acknowledged edits with those seen."""
    made = {r: t for editor in editors for r, t in editor.acknowledged.items()}
    counts["events"] += sum(len(w.seen) for w in watchers)
    counts["compacted"] += sum(w.compacted for w in watchers)
    counts["bookmarks"] += sum(w.bookmarks for w in watchers)
    counts["twice"] += sum(w.twice for w in watchers)
    counts["out of order"] += sum(w.disordered for w in watchers)
    counts["left out"] += sum(w.missing for w in watchers)
    counts["wrong bookmarks"] += sum(w.wrong_bookmarks for w in watchers)
    for watcher in watchers:
        if not watcher.compacted:
            counts["left out"] += len(set(range(1, last + 1)) - set(watcher.seen))
        for revision, transaction in watcher.seen.items():
            if revision in made:
                counts["half or other"] += transaction != made[revision]
    counts["left out"] += last - len(made)  # each edit was acknowledged in the end


def refuses_old(scene):
    try:
        scene.watch(1)
    except hg.OutOfRange as error:
        return "compacted" in str(error) and error.expected > 1
    return False


def stalled(scene, over):
    """A watch of which only the first reply is read."""
    link = scene.client.connection.link
    call = link.method("Watch", raw=True)(
        service.WatchRequest(scene=scene.id), metadata=link.metadata
    )
    next(call)
    threading.Thread(target=lambda: (over.wait(), call.cancel()), daemon=True).start()
    return call


def memory(report):
    """Watchers that read nothing while events of 1 MB pass."""
    limits = {"stall_seconds": 30, "watch_bytes": 48 * EVENT}
    with common.daemon(**limits) as client:
        scene = client.create_scene("room", lifetime="daemon")

        def put(count):
            for _ in range(count):
                with scene.edit() as edit:
                    edit.texture("noise", noise)

        noise = np.random.default_rng(0).integers(0, 255, (EVENT // 2048 - 1, 512, 4), "u1")
        put(60)
        time.sleep(1.5)  # the heap's holes went back to the system
        before = common.resident(common.pid_of(client))
        over = threading.Event()
        with hg.connect(client.address) as slow:
            calls = [stalled(hg.Scene(slow, scene.id), over) for _ in range(READERS)]
            put(40)
            time.sleep(1.5)
            assert common.used(client, "tenant_streams") == READERS, "they were closed too soon"
            each = (common.resident(common.pid_of(client)) - before) / len(calls) / EVENT
            report.figure("memory of each that reads nothing", each, 3, "ev", slack=False)
            if not common.SHORT:
                closed = common.seconds_until(
                    lambda: common.used(client, "tenant_streams") == 0, limits["stall_seconds"] + 30
                )
                report.figure("closed after", closed, limits["stall_seconds"] + 5, "s")
            over.set()


def main():
    names = ("twice", "out of order", "left out", "half or other", "wrong bookmarks")
    with common.Report("R5 watch") as report:
        for kept, title in ((0, "all kept"), (KEPT, f"{KEPT} events kept")):
            counts = dict.fromkeys((*names, "events", "kills", "compacted", "bookmarks"), 0)
            counts["told nothing of what is compacted"] = 0
            for _ in range(RUNS):
                with tempfile.TemporaryDirectory() as folder:
                    run(folder, SECONDS, kept, counts)
            counted = ", ".join(
                f"{counts[name]} {name}" for name in ("kills", "events", "compacted", "bookmarks")
            )
            print(f"  {title}: {RUNS} runs of {SECONDS} s, {counted}")
            for name in names:
                report.figure(f"{title}: {name}", counts[name], 0)
            if not kept:
                report.figure("all kept: compacted nevertheless", counts["compacted"], 0)
            name = "told nothing of what is compacted"
            report.figure(f"{title}: {name}", counts[name], 0)
            report.figure(f"{title}: runs without events or bookmarks", not_any(counts), 0)
        memory(report)


def not_any(counts):
    return sum(counts[name] == 0 for name in ("events", "bookmarks"))


if __name__ == "__main__":
    main()
