"""The Python client as on a machine without Linux's own modules. Run by test_elsewhere.py.

usage: elsewhere.py ADDRESS TOKEN [CA]   the daemon's TCP address; with CA over TLS
Prints "fine" when all went well.
"""

import asyncio
import multiprocessing.connection  # noqa: F401  what others import is theirs: only heliograph
import os
import pathlib
import select
import signal
import socket
import subprocess  # noqa: F401  meets the blocks below
import sys
import tempfile

import grpc.aio  # noqa: F401
import numpy as np
import PIL.Image
import tqdm  # noqa: F401

MODULES = ["fcntl", "grp", "pwd", "resource", "termios", "tty", "pty", "syslog", "_posixshmem"]
GONE = {
    os: [
        *("fork", "forkpty", "register_at_fork", "pidfd_open", "memfd_create", "eventfd"),
        *("geteuid", "getuid", "getgid", "mkfifo", "sched_getaffinity", "pipe2", "posix_spawn"),
        *("killpg", "setsid", "getpgid", "fchmod", "wait4", "openpty", "O_NOFOLLOW", "O_DIRECTORY"),
    ],
    socket: ["AF_UNIX", "SOCK_SEQPACKET", "recv_fds", "send_fds", "SCM_RIGHTS", "SO_PEERCRED"],
    select: ["poll"],
    signal: ["SIGKILL", "SIGUSR1", "pthread_sigmask", "setitimer"],
}


def block():
    """Removes what is missing on Windows, or on macOS."""
    import mmap

    for name in MODULES:
        sys.modules[name] = None  # an import fails
    for module, names in GONE.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    for name in ("MAP_SHARED", "PROT_READ", "PROT_WRITE"):
        delattr(mmap, name)


def furnish(hg, scene):
    with scene.edit() as edit:
        edit.sample_studio()
        ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.5))
        edit.texture("big", np.zeros((600, 600, 4), "u1"))  # uploaded: over 1 MiB
        many = edit.instances("many", transforms=np.tile(np.eye(4), (20_000, 1, 1)))
        edit.entity("ball", mesh=ball, category="ball", transform=hg.Pose((0, 0, 0.5)))
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
    return many


def work(hg, client, folder):
    with client.create_scene() as scene:
        many = furnish(hg, scene)
        frame = scene.render("cam", planes=["beauty", "depth", "instance"], spp=4)
        assert frame["instance"].max() > 0 and np.isfinite(frame["beauty"]).all()
        for name in ("out.png", "out.npz", "out.exr"):
            frame.save(folder / name)
        assert PIL.Image.open(folder / "out.png").size == (64, 48)
        jobs = [hg.Job("cam", spp=1, seed=i, tag=i) for i in range(4)]
        assert sorted(r.tag for r in scene.render_batch(jobs) if r.frame) == [0, 1, 2, 3]
        with scene.stream("cam", spp=4) as live:
            assert next(live).revision == 1
        assert scene.cast_rays([[0.05, 0.02, 3]], [[0, 0, -1]]).t[0] < 3
        assert scene.transforms(many[:3]).shape == (3, 4, 4)
        scene.save(folder / "x.helio")
        with client.load_scene(folder / "x.helio") as again:
            assert np.array_equal(again.render("cam", spp=4)["beauty"], frame["beauty"])
        try:
            scene.render("nobody")
            raise AssertionError("not refused")
        except hg.NotFound as error:
            assert error.field == "cameras[0]", error.field


async def work_async(hg, address, options):
    from heliograph import aio

    async with await aio.connect(address, **options) as client:
        scene = await client.create_scene()
        async with scene.edit() as edit:
            lens = hg.Camera.from_fov(50, 8, 8, degrees=True)
            edit.entity("cam", camera=lens)
        assert (await scene.render("cam", planes=["depth"]))["depth"].shape == (8, 8)


def refuses(hg, call, text):
    try:
        call()
    except hg.Unavailable as error:
        assert text in str(error), error
    else:
        raise AssertionError("not refused")


def main(address, token, ca=""):
    loop = asyncio.new_event_loop()  # Linux's own needs what is about to go
    block()
    import heliograph as hg

    options = {"token": token}
    if ca:
        options["tls"] = hg.TLS(ca=ca)
    with tempfile.TemporaryDirectory() as folder, hg.connect(address, **options) as client:
        work(hg, client, pathlib.Path(folder))
    loop.run_until_complete(work_async(hg, address, options))
    loop.close()
    refuses(hg, hg.connect, "Linux")
    refuses(hg, lambda: hg.connect("unix:///tmp/h.sock"), "host:port")
    print("fine")


if __name__ == "__main__":
    main(*sys.argv[1:])
