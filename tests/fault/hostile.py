"""A tenant that takes all it can get: sessions, scenes, memory, jobs, questions, decodes, uploads
that never come, large messages, descriptors that hang, bytes that are no call. Another tenant's
frames go on, the daemon is live and ready, and its memory stays within what it may have.

usage: hostile.py [--short], or by itself: hostile.py --be NAME FOLDER [--short]
"""

import contextlib
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
import time

import announced_uploads
import common
import decodes
import grpc
import health
import heliograph as hg
import hostile_descriptors
import ledger
import numpy as np
import served
from heliograph._wire._proto import scene_pb2, types_pb2
from heliograph._wire._proto import service_pb2 as service

SECONDS = common.size(6, 0.7)
MEMORY = 2 << 30
AT_ONCE = 16
LARGE = "x" * (48 << 20)  # bytes of a message


def sessions(client, _):
    address, token = client.address, served.TOKENS["robots"]
    with contextlib.ExitStack() as stack:
        while True:
            stack.enter_context(hg.connect(address, token=token)).info()


def scenes(client, _):
    while True:
        client.create_scene()


def attributes(client, _):
    scene = client.create_scene()
    for number in range(1, 1000):
        ledger.apply(scene, ledger.put(scene, number, f"e{number}", "x" * (8 << 20)))


def textures(client, _):
    with client.create_scene() as scene:
        for number in range(1000):
            with scene.edit() as edit:
                edit.texture(f"t{number}", np.full((2048, 2048, 4), number % 251, "u1"))


def at_once(call):
    """Many of a call at a time."""

    def run():
        with contextlib.suppress(hg.HeliographError, grpc.RpcError):
            call()

    threads = [threading.Thread(target=run, daemon=True) for _ in range(AT_ONCE)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def jobs(client, _):
    scene = common.stage(client, 1024, 1024)
    at_once(lambda: list(ledger.begin(client, "Render", ledger.long_job(scene))))


def questions(client, _):
    scene = common.stage(client, 16, 16)
    question = service.SampleSurface(entities=[types_pb2.Ref(name="ball")], count=1 << 20)
    request = service.QueryRequest(scene=scene.id, sample_surface=question)
    at_once(lambda: list(ledger.begin(client, "Query", request)))


def messages(client, _):
    """Edits of a scene that is not there: each is read before it is refused."""
    edit = scene_pb2.Edit(target=types_pb2.Ref(name="e"))
    edit.entity.attributes.values["k"] = LARGE
    request = service.ApplyRequest(scene=1, number=1)
    request.transaction.edits.append(edit)
    at_once(lambda: ledger.begin(client, "Apply", request).result())


def uploads(client, _):
    over = threading.Event()
    calls = announced_uploads.announce(client, over)
    for call in calls:
        announced_uploads.end_of(call)


def pictures(client, folder):
    path = folder / "picture.png"
    for number in range(1000):
        path.write_bytes(decodes.picture(3000, number))
        at_once(lambda: decodes.seconds_of(client, path))


def descriptors(client, _):
    path, kept = client.address.removeprefix("unix://"), []
    for _ in range(4):
        for bring in (
            hostile_descriptors.one,
            hostile_descriptors.many,
            hostile_descriptors.unread,
        ):
            bring(path, kept)
    time.sleep(SECONDS)


def noise(client, _):
    path = client.address.removeprefix("unix://")
    while True:
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(path)
        with contextlib.suppress(OSError):
            connection.sendall(np.random.default_rng(0).bytes(1 << 16))
        connection.close()


def strange_calls(client, _):
    link, number = client.connection.link, 0
    while True:
        number += 1
        call = link.channel.unary_unary(f"/heliograph.v1.Renderer/{'x' * 4000}{number}")
        with contextlib.suppress(grpc.RpcError):
            call(b"", metadata=[*link.metadata, ("user", "?" * 4000)], timeout=5)


ACTS = (
    sessions,
    scenes,
    attributes,
    textures,
    jobs,
    questions,
    messages,
    uploads,
    pictures,
    descriptors,
    noise,
    strange_calls,
)


def be(name, folder):
    """Does it again and again, whatever the reply, and is killed in the middle of it."""
    act = next(each for each in ACTS if each.__name__ == name)
    address = f"unix://{folder}/run/heliograph.sock"
    client = hg.connect(address, token=served.TOKENS["robots"])
    client.info()
    print("ready", flush=True)
    while True:
        with contextlib.suppress(hg.HeliographError, grpc.RpcError, OSError):
            act(client, pathlib.Path(folder))
        time.sleep(0.01)


class Other:
    """The tenant whose frames go on: each after an edit that brings a mesh of its own."""

    def __init__(self, client):
        self.scene, self.failed, self.drawn = common.stage(client, 64, 64), 0, 0

    def frames(self, seconds):
        """Seconds of each."""
        took, until = [], time.perf_counter() + seconds
        while time.perf_counter() < until:
            start = time.perf_counter()
            self.drawn += 1
            try:
                with self.scene.edit() as edit:
                    size = 0.5 + 0.001 * (self.drawn % 100)
                    edit.mesh("mesh", **hg.shapes.sphere(size, segments=8))
                self.scene.render("cam", spp=1, planes=["beauty"], labels=False)
            except hg.HeliographError as error:
                print("   ", error)
                self.failed += 1
            took.append(time.perf_counter() - start)
        return took


def judge(report, name, other, folder):
    quiet = other.frames(SECONDS)
    program = [sys.executable, __file__, *sys.argv[1:], "--be", name, folder]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as hostile:
        if hostile.stdout.readline() != "ready\n":
            raise RuntimeError(f"{name}: it ended before it was ready")
        took = other.frames(SECONDS)
        hostile.kill()
    fair, late = 2 * common.percentile(quiet, 0.99), common.percentile(took, 0.99)
    print(
        f"    {name}: alone p99 {500 * fair:.1f} ms, beside it {1000 * late:.1f} ms ({len(took)})"
    )
    report.figure(f"{name}: p99 over fair share's time", late / fair, 2)


def main():
    if "--be" in sys.argv:
        name, folder = sys.argv[sys.argv.index("--be") + 1 :][:2]
        return be(name, folder)
    with (
        common.Report("a hostile tenant") as report,
        tempfile.TemporaryDirectory(prefix="hg-") as folder,
    ):
        tenants = ("--tenants", served.tenants_file(folder))
        limits = ledger.limit_flags(memory_bytes=MEMORY)
        with served.served(*tenants, *limits, "--grace", "0", folder=folder) as daemon:
            with hg.connect(daemon.socket, token=served.TOKENS["vision"]) as client:
                watch = health.Health(client).watch()
                other = Other(client)
                for act in ACTS:
                    judge(report, act.__name__, other, folder)
                live = health.Health(client).check("")
                report.figure("frames that failed", other.failed, 0, slack=False)
                unready = sum(not ready for _, ready in watch.seen)
                report.figure("times not ready", unready, 0, slack=False)
                report.figure("not live", not live, 0, slack=False)
                most = common.peak(daemon.pid) / MEMORY
                report.figure("memory, of what it may have", most, 1.1, slack=False)
                watch.close()


if __name__ == "__main__":
    main()
