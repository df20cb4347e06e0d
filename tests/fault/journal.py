"""Limits of durable scenes: recovery in bounded memory, a disk that shrinks again, and a full one,
which one tenant filled and others go on editing, or where scenes can be deleted nevertheless."""

import contextlib
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

import heliograph as hg
from common import Report, peak, percentile, resident, seconds_until, size
from heliograph._wire._proto import scene_pb2 as pb
from heliograph._wire._proto import service_pb2 as service
from served import TOKENS, Served, tenants_file

MEGA = 1 << 20
ATTRIBUTE = 10 * MEGA
EDITS = size(1000, 30)
SMALL = size(1_000_000, 2_000)  # edits of a few bytes
PLACES = 100  # entities that they move
DISK = 96  # MiB


def text(number, length):
    return chr(97 + number % 26) * length


def entity_of(name, number, length):
    """A transaction of one entity with an attribute of this length."""
    transaction = pb.Transaction()
    edit = transaction.edits.add()
    edit.target.name = name
    edit.entity.attributes.values["text"] = text(number, length)
    return transaction


def on_disk(folder):
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())


def restarted(report, folder, state, name):
    """A daemon that recovers what one that was killed left; what that took."""
    begun = time.perf_counter()
    daemon = Served(folder, "--state-dir", state)
    with hg.connect(daemon.socket):
        took = time.perf_counter() - begun
    settled, most = resident(daemon.pid), peak(daemon.pid)
    print(f"  {name}: {settled / MEGA:.0f} MiB, {most / MEGA:.0f} at most")
    report.figure(f"{name}: memory, of what the daemon has then", most / settled, 2, slack=False)
    report.figure(f"{name}: recovered after", took, 5, "s")
    return daemon


def growth(report, folder):
    """One attribute, replaced again and again."""
    state = folder / "state"
    daemon = Served(folder, "--state-dir", state)
    most = 0
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="disk")
        for number in range(EDITS):
            scene.apply(entity_of("one", number, ATTRIBUTE))
            most = max(most, on_disk(state))
        daemon.kill()
    print(f"  {EDITS} edits of {ATTRIBUTE / MEGA:.0f} MiB: {most / MEGA:.0f} MiB of disk at most")
    daemon = restarted(report, folder, state, "large edits")
    with hg.connect(daemon.socket) as client:
        revision = client.open_scene("room").revision
        report.figure("large edits lost", EDITS - revision, 0, slack=False)
    daemon.stop()
    live = on_disk(state) / ATTRIBUTE
    report.figure("disk after a drain, of the live state", live, 3, slack=False)


def many_edits(report, folder):
    """Small edits of one scene, sent without a wait for their replies."""
    state = folder / "state"
    daemon = Served(folder, "--state-dir", state)
    most = 0
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="disk")

        def requests():
            for number in range(1, SMALL + 1):
                edits = entity_of(f"e{number % PLACES}", number, 8)
                yield service.ApplyRequest(scene=scene.id, number=number, transaction=edits)

        link = client.connection.link
        begun = time.perf_counter()
        for reply in link.method("ApplyStream")(requests(), metadata=link.metadata):
            if reply.HasField("status"):
                raise RuntimeError(reply.status)
            if reply.revision % 10_000 == 0:
                most = max(most, on_disk(state))
        took = time.perf_counter() - begun
        daemon.kill()
    print(f"  {SMALL} edits, {SMALL / took:.0f} a second: {most / MEGA:.1f} MiB of disk at most")
    daemon = restarted(report, folder, state, "small edits")
    with hg.connect(daemon.socket) as client:
        revision = client.open_scene("room").revision
        report.figure("small edits lost", SMALL - revision, 0, slack=False)
    daemon.stop()


def one_scene(report, folder):
    """A scene of many entities, made by so many edits that recovery writes a snapshot as well."""
    state = folder / "state"
    edits = size(110_000, 5_000)
    daemon = Served(folder, "--state-dir", state, "--limit", f"snapshot_edits={edits * 10 // 11}")
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="disk")
        for number in range(edits):
            with scene.edit() as edit:
                for name in (f"a{number}", f"b{number}"):
                    edit.entity(name, attributes={"text": "x"})
                if number % 10 == 0:
                    edit.material(f"m{number}", base_color=(0.5, 0.5, 0.5))
        daemon.kill()
    for name in ("one scene", "its snapshot"):
        daemon = restarted(report, folder, state, name)
        with hg.connect(daemon.socket) as client:
            entities = client.open_scene("room").describe().counts.entities
            report.figure(f"{name}: entities lost", 2 * edits - entities, 0, slack=False)
        daemon.kill()


def many_scenes(report, folder):
    """Scenes that are large themselves: recovery holds no second copy of all."""
    state = folder / "state"
    daemon = Served(folder, "--state-dir", state)
    with hg.connect(daemon.socket) as client:
        for k in range(size(16, 8)):
            scene = client.create_scene(f"room {k}", lifetime="disk")
            for number in range(4):
                scene.apply(entity_of(f"e{number}", number, 2 * ATTRIBUTE // 5))
        daemon.kill()
    restarted(report, folder, state, "many scenes").stop()


@contextlib.contextmanager
def small_disk(folder):
    """A folder on a file system of its own."""
    path = pathlib.Path(folder) / "disk"
    path.mkdir()
    options = f"size={DISK}m,mode=0700"
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", path])
    if mounted.returncode != 0:
        print("  a tmpfs cannot be mounted here")
        if os.geteuid() == 0:
            sys.exit(1)
        yield None
        return
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", path], check=True)


class Tenant:
    """A tenant's scene, with an entity for each edit."""

    def __init__(self, daemon, name):
        self.client = hg.connect(daemon.socket, token=TOKENS[name])
        self.scene = self.client.create_scene(name, lifetime="disk")
        self.made = 0

    def make(self, length=0):
        """None, or why not."""
        try:
            self.scene.apply(entity_of(f"e{self.made}", self.made, length))
        except (hg.errors.ResourceExhausted, hg.Unavailable) as error:
            return error
        self.made += 1
        return None

    def fill(self):
        """Makes entities of 4 MiB until that is refused twice, the second time a second later."""
        refused = 0
        while refused < 2:
            error = self.make(4 * MEGA)
            refused += error is not None
            if error:
                refusal = error
                time.sleep(1.2)
        return refusal


def filled_by_a_tenant(report, disk, tenants):
    daemon = Served(disk.parent, "--state-dir", disk / "state", "--tenants", tenants)
    large, small = Tenant(daemon, "robots"), Tenant(daemon, "vision")
    refusal = large.fill()
    print(f"  the first is refused after {large.made} edits: {refusal}")
    refused = sum(small.make() is not None for _ in range(200))
    report.figure("edits of another tenant that were refused", refused, 0, slack=False)
    info = large.client.info()
    writing = info.journal == info.JOURNAL_WRITING
    report.figure("not writing", not writing, 0, slack=False)
    report.figure("not told by name", "disk_spare_bytes" not in str(refusal), 0, slack=False)
    large.scene.delete()
    took = seconds_until(lambda: on_disk(disk / "state") < 24 * MEGA)
    report.figure("until its room is given back", took, 3, "s")
    report.figure("edits refused after that", small.make(4 * MEGA) is not None, 0, slack=False)
    daemon.stop()


def beside(report, folder):
    """Small edits of one tenant beside large ones of another."""
    flags = ("--state-dir", folder / "state", "--tenants", tenants_file(folder))
    daemon = Served(folder, *flags)
    large, small = Tenant(daemon, "robots"), Tenant(daemon, "vision")
    running = threading.Event()

    def write():
        for number in range(size(100, 20)):
            large.scene.apply(entity_of("one", number, 8 * MEGA))
            running.set()
        running.clear()

    writer = threading.Thread(target=write)
    writer.start()
    running.wait()
    seconds = []
    while running.is_set():
        begun = time.perf_counter()
        assert small.make() is None
        seconds.append(time.perf_counter() - begun)
    writer.join()
    print(f"  {len(seconds)} small edits beside large ones")
    report.figure("p99 of a small edit beside 8 MiB ones", percentile(seconds, 0.99), 0.05, "s")
    daemon.stop()


def filled_by_others(report, disk, tenants):
    """Another program takes all that is left: scenes can still be deleted."""
    flags = ("--state-dir", disk / "state", "--tenants", tenants)
    daemon = Served(disk.parent, *flags)
    large, small = Tenant(daemon, "robots"), Tenant(daemon, "vision")
    for _ in range(6):
        large.make(4 * MEGA)
    small.make()
    ballast = disk / "ballast"
    with open(ballast, "wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(4096)):
            pass
    took = seconds_until(lambda: small.make() is not None, 60)
    report.figure("a full disk is told of after", took, 30, "s")
    report.figure("deletion refused", not deleted(large.scene), 0, slack=False)
    took = seconds_until(lambda: small.make() is None)
    report.figure("edits go on after", took, 5, "s")
    made = small.made
    daemon.kill()
    daemon = Served(disk.parent, *flags)
    with hg.connect(daemon.socket, token=TOKENS["vision"]) as client:
        entities = client.open_scene("vision").describe().counts.entities
        report.figure("edits lost", made - entities, 0, slack=False)
    ballast.unlink()
    daemon.stop()


def deleted(scene):
    try:
        scene.delete()
    except hg.errors.HeliographError as error:
        print(f"  deletion: {error}")
        return False
    return True


def main():
    with Report("journal") as report:
        for part in (growth, many_edits, one_scene, many_scenes, beside):
            with tempfile.TemporaryDirectory(prefix="hg-") as folder:
                part(report, pathlib.Path(folder))
        for part in (filled_by_a_tenant, filled_by_others):
            with tempfile.TemporaryDirectory(prefix="hg-") as folder:
                tenants = tenants_file(folder)
                with small_disk(folder) as disk:
                    if disk:
                        part(report, disk, tenants)


if __name__ == "__main__":
    main()
