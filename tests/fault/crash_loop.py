"""kill -9 while clients edit durable scenes: nothing acknowledged is lost, half there, or there
twice, and the scenes are those of a model."""

import pathlib
import tempfile
import time

import heliograph as hg
import numpy as np
from common import Report, seconds_until, size
from heliograph._wire._proto import scene_pb2 as pb
from heliograph._wire.arrays import inline
from served import Served
from worker import Worker

STREAMS = 8
KILLS = size(200, 6)
ALIVE_SECONDS = 0.3


class Editor(Worker):
    """One client, which counts: each edit moves two entities of its own and makes one more."""

    def __init__(self, address, number):
        self.client = hg.connect(address)
        self.scene = self.client.open_scene(f"room {number % 2}")
        self.number = number
        self.acknowledged = []  # (revision, transaction, id of the entity that it made)
        super().__init__()

    def run(self):
        while not self.stopping.is_set():
            transaction = self._next()
            reply = self.scene.apply(transaction)
            ids = [int.from_bytes(reply.ids[k : k + 8], "little") for k in (0, 8, 16)]
            self.acknowledged.append((reply.revision, transaction, ids[2]))

    def _next(self):
        count = len(self.acknowledged) + 1
        transaction = pb.Transaction()
        for name in (f"{self.number}.a", f"{self.number}.b", ""):
            edit = transaction.edits.add()
            if name:
                edit.target.name = name
            edit.entity.pose.matrices.CopyFrom(at(count))
        return transaction


def acknowledged(editors):
    for editor in editors:
        if editor.failed:
            raise editor.failed
    return sum(len(editor.acknowledged) for editor in editors)


def at(x):
    """A pose as a message."""
    matrix = np.eye(4, dtype="<f4")
    matrix[0, 3] = x
    return inline(matrix)


def check(editors):
    """(lost, torn, twice, differing scenes)"""
    missing = torn = twice = differing = 0
    for room in (0, 1):
        mine = [e for e in editors if e.number % 2 == room]
        scene = mine[0].scene
        made = sum(len(e.acknowledged) for e in mine)
        entities = scene.describe().counts.entities
        twice += max(0, entities - made - 2 * len(mine))
        missing += max(0, made + 2 * len(mine) - entities)
        for editor in mine:
            count = len(editor.acknowledged)
            a, b = (m[0, 3] for m in scene.transforms([f"{editor.number}.{n}" for n in "ab"]))
            torn += a != b
            missing += a < count
            twice += a > count
            ids = [id for _, _, id in editor.acknowledged]
            poses = scene.transforms([scene.handle(id) for id in ids])
            missing += int((poses[:, 0, 3] != range(1, count + 1)).sum())
        differing += saved(scene) != saved(replayed(mine))
    return missing, torn, twice, differing


def replayed(editors):
    """A plain scene, made by what was acknowledged, in the order of its revisions."""
    model = editors[0].client.create_scene()
    every = [(revision, t) for e in editors for revision, t, _ in e.acknowledged]
    for _, transaction in sorted(every, key=lambda item: item[0]):
        model.apply(transaction)
    return model


def saved(scene):
    """The scene file's bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "scene"
        scene.save(path)
        return path.read_bytes()


def main():
    with Report("crash loop") as report, tempfile.TemporaryDirectory() as folder:
        flags = ("--state-dir", f"{folder}/state", "--limit", "snapshot_edits=2000")
        daemon = Served(folder, *flags)
        with hg.connect(daemon.socket) as client:
            for room, lifetime in enumerate(("disk", "disk_synced")):
                client.create_scene(f"room {room}", lifetime=lifetime)
        editors = [Editor(daemon.socket, number) for number in range(STREAMS)]
        alive = 0.0
        for _ in range(KILLS):
            before = acknowledged(editors)
            seconds_until(lambda before=before: acknowledged(editors) > before)
            start = time.perf_counter()
            time.sleep(ALIVE_SECONDS)
            daemon.kill()
            alive += time.perf_counter() - start
            daemon = Served(folder, *flags)
        for editor in editors:
            editor.stop()
        edits = acknowledged(editors)
        rate = edits / STREAMS / alive
        print(f"  {KILLS} kills, {STREAMS} streams, {edits} edits, {rate:.0f}/s each")
        missing, torn, twice, differing = check(editors)
        report.figure("edits lost", missing, 0)
        report.figure("edits half there", torn, 0)
        report.figure("edits twice", twice, 0)
        report.figure("scenes that are not what a model says", differing, 0)
        for editor in editors:
            editor.client.close()
        daemon.stop()


if __name__ == "__main__":
    main()
