"""Clients that load a daemon, each in a process of its own, which may end by kill -9 at any
moment. Used by churn.py and soak.py."""

import contextlib
import faulthandler
import itertools
import multiprocessing
import os
import pathlib
import random
import signal
import time

import common
import heliograph as hg
import numpy as np

LONGEST = 60  # seconds that a piece of work may take on a busy machine
ROOM = {"threads": 8}  # that may be left: gRPC keeps those of a busy moment
MODEL = pathlib.Path(__file__).parents[1] / "assets/gltf/simple-instancing.glb"


def furnish(client, dice):
    """A private scene with a mesh, a texture, a light and a camera, like no other's."""
    scene = client.create_scene()
    with scene.edit() as edit:
        texels = np.random.default_rng(dice.randrange(1 << 30)).integers(0, 255, (64, 64, 3))
        paint = edit.material("paint", base_color=edit.texture("dots", texels.astype("u1")))
        ball = edit.mesh("mesh", **hg.shapes.sphere(0.5, 16))
        edit.entity("ball", mesh=ball, material=paint, label="auto")
        edit.instances("many", transforms=np.tile(np.eye(4), (200, 1, 1)), mesh=ball)
        edit.dome(texels[:8, :16].astype("f4") / 255)
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))
    return scene


def edits(scene, dice):
    many = scene.find("many/*")
    poses = np.tile(np.eye(4), (200, 1, 1))
    for i in range(100):
        with scene.edit() as edit:
            poses[:, 0, 3] = i * 0.01
            edit.set_transforms(many, poses)
    with scene.edit() as edit:
        positions = hg.shapes.sphere(0.5 + 0.1 * dice.random(), 128)  # over 1 MiB: mapped
        edit.mesh("large", **positions)


def renders(scene, dice):
    frame = scene.render("cam", planes=["beauty", "instance"], spp=4, seed=dice.randrange(1000))
    assert np.isfinite(frame["beauty"]).all()


def batches(scene, dice):
    jobs = (hg.Job("cam", spp=2, seed=i, tag=i) for i in itertools.count())
    results = scene.render_batch(jobs)
    for _ in range(dice.randrange(1, 20)):
        assert next(results).frame.height == 48
    results.close()


def streams(scene, dice):
    with scene.stream("cam", spp=64) as live:
        for _ in range(dice.randrange(1, 20)):
            if next(live).is_final or dice.random() < 0.3:  # none follows a final one by itself
                live.update(seed=dice.randrange(1000))


def branches(scene, dice):
    made = [scene.branch() for _ in range(8)]
    for branch in made:
        with branch.edit() as edit:
            edit.entity("ball", transform=hg.Pose((dice.random(), 0, 0)))
        branch.render("cam", planes=["depth"])
        branch.delete()


def questions(scene, dice):
    rays = np.random.default_rng(0).normal(size=(1000, 3)) + (0, 0, 3)
    scene.cast_rays(np.zeros((1000, 3)), rays)
    assert scene.transforms(["ball"]).shape == (1, 4, 4) and scene.find("many/*")
    with contextlib.suppress(hg.NotFound):
        scene.render(f"nobody {dice.random()}")


def assets(scene, dice):
    with scene.edit() as edit:
        edit.import_file(MODEL, name=f"model {dice.random()}")


def cancels(scene, dice):
    with contextlib.suppress(hg.DeadlineExceeded):
        scene.render("cam", spp=1 << 20, size=(640, 480), timeout=0.05 + 0.1 * dice.random())


WORK = (edits, renders, batches, streams, branches, questions, assets, cancels)


def watched():
    """From here on, a process that takes LONGEST shows where it is, and fails."""
    faulthandler.dump_traceback_later(LONGEST, exit=True)


def visit(address, seed, seconds, killed):
    """One client from its connection to its end; of 0 seconds it renders once. Runs in a process of
    its own."""
    dice = random.Random(seed)
    until = time.monotonic() + seconds
    watched()
    client = hg.connect(address)
    scene = furnish(client, dice)
    while True:
        watched()
        (dice.choice(WORK) if seconds else renders)(scene, dice)
        if time.monotonic() > until:
            break
    if killed:
        os.kill(os.getpid(), signal.SIGKILL)
    watched()
    client.close()
    faulthandler.cancel_dump_traceback_later()


class Crowd:
    """Starts visits in processes that were warmed up once, and counts those that failed."""

    def __init__(self, address):
        self.address = address
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(
            ["load", "heliograph.client.client", "heliograph.client.edit"]
        )
        self._visits = {}
        self._seed = 0
        self.failed = 0
        self.ended = 0

    def start(self, seconds, killed):
        self._seed += 1
        words = (self.address, self._seed, seconds, killed)
        process = self._context.Process(target=visit, args=words, daemon=True)
        process.start()
        self._visits[process] = killed

    def reap(self):
        """Joins the processes that ended; returns how many are left."""
        for process, killed in list(self._visits.items()):
            if process.exitcode is not None:
                self.failed += process.exitcode != (-signal.SIGKILL if killed else 0)
                self.ended += 1
                del self._visits[process]
                process.close()
        return len(self._visits)


def holdings(client):
    """Use by the daemon that must come back to where it was."""
    pid = common.pid_of(client)
    links = []
    for fd in pathlib.Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            links.append(os.readlink(fd))
    used = client.info().used
    return {
        "scenes": len(client.scenes()),
        "fds": len(links),
        "memfds": sum("memfd:" in link for link in links),
        "threads": len(list(pathlib.Path(f"/proc/{pid}/task").iterdir())),
        **{name: used[name] for name in ("tenant_entities", "tenant_streams", "tenant_jobs")},
    }
