"""R13 on the GPU: what does not fit a budget of its memory is refused, and costs nothing else.

usage: .venv/bin/python tests/gpu/memory.py   (needs an NVIDIA GPU with 4 GiB free; 60 s)
For several budgets: a scene twice as large is RESOURCE_EXHAUSTED with needed and available, keeps
its revision, and its next picture without what was too large is the same bit for bit; scenes that
do not fit together give the same pictures in turn; so do those of many clients at once, or they are
refused; frames that stay on the GPU are of the budget; the driver is never asked for more. Prints
its figures beside what is promised; ends with 1 when one was missed.
"""

import contextlib
import gc
import pathlib
import re
import socket
import subprocess
import sys
import threading
import urllib.request

import heliograph as hg
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "fault"))
import common

MIB = 1 << 20
BUDGETS = (96, 256, 448)  # MiB
SCENES = 12
PICTURE = {"planes": ["beauty", "depth", "instance"], "spp": 8, "progress": False}
BESIDE = 96  # MiB that the driver needs for what runs, beside what it is asked for


class Daemon:
    """A private daemon with a budget, and its metrics."""

    def __init__(self, budget):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.metrics = f"127.0.0.1:{free.getsockname()[1]}"
        arguments = ["--backend", "cuda", "--grace", "0", "--metrics", self.metrics]
        self.client = hg.connect(arguments=[*arguments, "--device-memory", str(budget)])

    def metric(self, name):
        with urllib.request.urlopen(f"http://{self.metrics}/metrics", timeout=5) as page:
            return float(re.search(rf"^{name} (\S+)$", page.read().decode(), re.M)[1])

    def used(self):
        return self.metric("heliograph_device_memory_bytes")


def gpu_mib():
    ask = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return sum(int(line) for line in subprocess.check_output(ask, text=True).split())


def paper(edit, name, megabytes, seed):
    """A square whose texture takes so much on the GPU, with its mips about a third more."""
    side = int((megabytes * MIB / 4) ** 0.5)
    texels = np.random.default_rng(seed).integers(0, 255, (side, side, 4), dtype="u1")
    texture = edit.texture(f"{name}/texels", texels)
    edit.material(f"{name}/paint", base_color=texture, roughness=0.7)
    corners = np.array([(-1, 0, 0), (1, 0, 0), (1, 0, 2), (-1, 0, 2)], "f4")
    uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], "f4")
    edit.mesh(f"{name}/mesh", positions=corners, indices=[(0, 1, 2), (0, 2, 3)], uvs=uvs)
    at = hg.Pose((0, 1, -0.4))
    edit.entity(name, mesh=f"{name}/mesh", material=f"{name}/paint", transform=at)


def equal(one, other):
    return all(np.array_equal(one[plane], other[plane]) for plane in PICTURE["planes"])


def refusal(run):
    try:
        run()
    except hg.ResourceExhausted as error:
        return error
    return None


def refused(report, budget):
    """A scene of twice the budget, in one texture and in many."""
    daemon = Daemon(budget * MIB)
    with daemon.client as client:
        scene, other = common.stage(client, 320, 240), common.stage(client, 160, 120)
        before, beside = scene.render("cam", **PICTURE), other.render("cam", **PICTURE)
        begun = gpu_mib()
        silent = wrong = moved = different = 0
        for parts in (1, 8):
            with scene.edit() as edit:
                for i in range(parts):
                    paper(edit, f"large/{i}", 2 * budget / parts, i)
            revision = scene.revision
            for _ in range(3):
                error = refusal(lambda: scene.render("cam", **PICTURE))
                silent += error is None
                if error is not None:
                    wrong += not 2 * budget * MIB <= error.needed > error.available > 0
                    wrong += error.available > budget * MIB
            moved += scene.revision - revision
            different += not equal(other.render("cam", **PICTURE), beside)
            with scene.edit() as edit:
                for i in range(parts):
                    edit.remove(f"large/{i}")
                edit.prune()
            different += not equal(scene.render("cam", **PICTURE), before)
        name = f"{budget} MiB: "
        report.figure(name + "scenes of twice as much not refused", silent, 0, slack=False)
        report.figure(name + "needed or available wrong", wrong, 0, slack=False)
        report.figure(name + "revisions moved", moved, 0, slack=False)
        report.figure(name + "next pictures that differ", different, 0, slack=False)
        report.figure(name + "device losses", daemon.metric("heliograph_device_losses_total"), 0)
        grown = gpu_mib() - begun
        report.figure(name + "memory of the GPU", grown, budget + BESIDE, "MiB", slack=False)


def in_turn(report, budget):
    """More scenes than fit, each a quarter of the budget."""
    daemon = Daemon(budget * MIB)
    with daemon.client as client:
        scenes = []
        for i in range(SCENES):
            scenes.append(client.create_scene())
            common.furnish(scenes[-1], 160, 120)
            with scenes[-1].edit() as edit:
                paper(edit, "paper", budget / 6, i)
        first = [scene.render("cam", **PICTURE) for scene in scenes]
        begun, most, copied = gpu_mib(), 0.0, client.info().uploaded_bytes
        different = 0
        for k in np.random.default_rng(0).permutation(np.repeat(np.arange(SCENES), 3)):
            different += not equal(scenes[k].render("cam", **PICTURE), first[k])
            most = max(most, daemon.used())
        same = sum(equal(a, b) for i, a in enumerate(first) for b in first[:i])
        again = (client.info().uploaded_bytes - copied) / MIB
        name = f"{budget} MiB, {SCENES} scenes: "
        report.figure(name + "pictures that differ", different, 0, slack=False)
        report.figure(name + "scenes that look the same", same, 0, slack=False)
        report.figure(name + "nothing was evicted", int(again < budget), 0, slack=False)
        report.figure(name + "budget used", most / MIB, budget, "MiB", slack=False)
        grown = gpu_mib() - begun
        report.figure(name + "growth in the rounds", grown, BESIDE, "MiB", slack=False)


def at_once(report, budget, clients=16):
    """Every client's pictures are right or refused; alone again, each is right."""
    daemon = Daemon(budget * MIB)
    picture = PICTURE | {"spp": 64, "size": (640, 480)}
    wrong, done = [], []

    def work(scene, expected):
        for _ in range(4):
            try:
                good = equal(scene.render("cam", **picture), expected)
                (done if good else wrong).append("differs")
            except hg.ResourceExhausted as error:
                if error.needed <= error.available:
                    wrong.append(str(error))
            except hg.HeliographError as error:
                wrong.append(str(error))

    with daemon.client as client, contextlib.ExitStack() as stack:
        jobs = []
        for i in range(clients):
            scene = stack.enter_context(hg.connect(client.address)).create_scene()
            common.furnish(scene, 640, 480)
            with scene.edit() as edit:
                paper(edit, "paper", budget / 12, i)
            jobs.append((scene, scene.render("cam", **picture)))
        threads = [threading.Thread(target=work, args=job) for job in jobs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        after = sum(not equal(scene.render("cam", **picture), was) for scene, was in jobs)
        print(f"  {len(done)} of {4 * clients} at once were rendered", *wrong[:3], sep="\n    ")
        name = f"{budget} MiB, {clients} clients: "
        report.figure(name + "wrong answers", len(wrong), 0, slack=False)
        report.figure(name + "none was rendered", int(not done), 0, slack=False)
        report.figure(name + "pictures that differ after", after, 0, slack=False)


def on_the_gpu(report, budget):
    """Frames that a client keeps there until no more fit."""
    daemon = Daemon(budget * MIB)
    with daemon.client as client:
        scene = common.stage(client, 1280, 720)
        before = scene.render("cam", **PICTURE)
        held, error = [], None
        while error is None and len(held) < 1000:
            error = refusal(lambda: held.append(scene.render("cam", device="cuda", **PICTURE)))
        most = daemon.used() / MIB
        count = len(held)
        held.clear()
        gc.collect()
        after = scene.render("cam", **PICTURE)
        with contextlib.suppress(hg.ResourceExhausted):
            held.append(scene.render("cam", device="cuda", **PICTURE))
        name = f"{budget} MiB of frames: "
        report.figure(name + "none refused", int(error is None or count == 0), 0, slack=False)
        report.figure(name + "budget used", most, budget, "MiB", slack=False)
        report.figure(name + "next picture differs", int(not equal(after, before)), 0, slack=False)
        report.figure(name + "none fits again", 1 - len(held), 0, slack=False)


def main():
    with common.Report("R13 device memory") as report:
        for budget in BUDGETS:
            refused(report, budget)
        for budget in BUDGETS[:2]:
            in_turn(report, budget)
        at_once(report, BUDGETS[0])
        on_the_gpu(report, BUDGETS[1])


if __name__ == "__main__":
    main()
