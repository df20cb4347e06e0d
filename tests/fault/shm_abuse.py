"""S10: nothing that a client does with shared memory hurts the daemon or shows other pixels: sealed
sizes, words that lie about ranges of its arenas and of others', mappings that outlive what they
show, arrays that overflow or shrink, leases returned in flight; and another user cannot reach any
of it."""

import concurrent.futures
import contextlib
import fcntl
import mmap
import multiprocessing
import os
import random
import socket

import common
import heliograph as hg
import numpy as np
from heliograph._wire import shared
from heliograph._wire._proto import types_pb2 as types

NOBODY = 65534
COUNT = common.size(1000, 60)


def local_channel_of(client):
    return client.connection.link._local_channel


def frames_kept(scene):
    """How many of frames that a client holds, reads and gives back, in threads, were changed."""

    def one(k):
        frame = scene.render("cam", planes=["position"], size=(256, 128), labels=False)
        kept = frame["position"][3:90:7]
        before = kept.copy()
        if k % 2:
            del frame
        for _ in range(3):
            scene.render("cam", planes=["position"], size=(256, 128), labels=False)
        return not np.array_equal(kept, before, equal_nan=True)

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        return sum(pool.map(one, range(COUNT // 4)))


def changed_by_client(scene):
    """How many ways there are to write into, or change the size of, a buffer of the daemon."""
    seen = []
    receive = socket.recv_fds

    def keep(*arguments):
        word, fds, *rest = receive(*arguments)
        seen.extend(os.dup(fd) for fd in fds)
        return word, fds, *rest

    socket.recv_fds = keep
    try:
        frame = scene.render("cam", planes=["position"], size=(700, 500), labels=False)
    finally:
        socket.recv_fds = receive
    done = 0
    for fd in seen:
        for change in (
            lambda fd=fd: os.ftruncate(fd, 0),
            lambda fd=fd: os.ftruncate(fd, 1 << 30),
            lambda fd=fd: os.pwrite(fd, b"x", 0),
            lambda fd=fd: mmap.mmap(fd, 4096, mmap.MAP_SHARED, mmap.PROT_WRITE),
            lambda fd=fd: fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE),
        ):
            with contextlib.suppress(OSError):
                change()
                done += 1
        os.close(fd)
    return done if seen and frame else 1


def lying_words(scene):
    """Words that name anything, with descriptors of anything, while frames go to and fro."""
    line, dice = local_channel_of(scene.client), random.Random(1)
    for k in range(10 * COUNT):
        number = dice.choice((0, 1, 5, 1 << 63, shared._UNMAPPED))
        word = shared._WORD.pack(dice.choice((1, 2, 3, 1 << 63)), number)
        with contextlib.suppress(BlockingIOError, TimeoutError):
            if k % 3:
                line.send(word[: dice.choice((16, 16, 16, 3))])
            else:
                with open(dice.choice(("/dev/null", "/dev/zero", __file__)), "rb") as file:
                    socket.send_fds(line, [word], [file.fileno()] * dice.choice((1, 2, 5)))
        if k % 50 == 0:
            with contextlib.suppress(hg.HeliographError, TimeoutError):
                scene.render("cam", planes=["position"], size=(256, 128), labels=False)


def lies_about_ranges(scene, most):
    """Every use of every arena, its own and others', is over, lost or unmapped, over and over."""
    line = local_channel_of(scene.client)
    for k in range(COUNT // 4):
        held = scene.render("cam", planes=["position"], size=(256, 128), labels=False)
        for generation in range(most):
            buffer = 1 + (generation + k) % 4
            for word in ((buffer, generation), (generation, 0), (buffer, shared._UNMAPPED)):
                with contextlib.suppress(BlockingIOError):
                    line.send(shared._WORD.pack(*word), socket.MSG_DONTWAIT)
        del held


def changed_beside_a_liar(scene):
    """How many frames of a client change while another lies about all ranges there are."""

    def lie():
        with contextlib.suppress(hg.HeliographError, TimeoutError):
            lies_about_ranges(common.stage(liar), most=64)

    with hg.connect(scene.client.address) as liar, concurrent.futures.ThreadPoolExecutor(1) as one:
        lying = one.submit(lie)
        held = [scene.render("cam", planes=["depth"], labels=False) for _ in range(COUNT // 4)]
        before = [frame["depth"].copy() for frame in held]
        lying.result()
        pairs = zip(held, before, strict=True)
        return sum(not np.array_equal(a["depth"], b, equal_nan=True) for a, b in pairs)


def shown_after_release(scene):
    """How many mappings show other pixels once their client has given all back and left them to the
    daemon, and that renders for it and others."""
    shown = 0
    with hg.connect(scene.client.address) as liar:
        theirs = common.stage(liar)
        for _ in range(COUNT // 20):
            frame = theirs.render("cam", planes=["depth"], labels=False)
            ours = liar.connection.link.shared
            number, arena = next(iter(ours._maps.items()))
            seen = np.frombuffer(arena.memory, np.uint8)
            before = seen.copy()
            del frame
            ours._maps.pop(number)
            ours._send(shared._WORD.pack(number, shared._UNMAPPED))
            for each in (scene, theirs):
                each.render("cam", planes=["position"], labels=False)
            shown += not np.array_equal(seen, before)
    return shown


def named(scene, **place):
    """True if an edit that names this range of a shared buffer is refused, as it must be."""
    poses = np.tile(np.eye(4), (20_000, 1, 1))
    data = poses.astype(np.float32)
    array = types.Array(dtype=types.D_TYPE_F32, shape=data.shape)
    array.buffer.CopyFrom(scene.client.connection.link.shared.hand_over(memoryview(data).cast("B")))
    for name, value in place.items():
        setattr(array.buffer, name, value)
    try:
        with scene.edit() as edit:
            edit.instances("copies", mesh="mesh", transforms=poses)
            edit.transaction.edits[-1].instances.matrices.CopyFrom(array)
    except (hg.InvalidArgument, hg.NotFound):
        return True
    return False


def overflows(scene):
    """How many ranges outside a buffer were taken."""
    most = (1 << 64) - 1
    ranges = [
        {"offset": 64},
        {"offset": most - 63},
        {"offset": most - 63, "size": 64},
        {"size": most},
        {"offset": 8},
        {"buffer": 12345},
        {"generation": 1},
    ]
    return sum(not named(scene, **each) for each in ranges)


def by_another_user(path, wire):
    os.setgroups([])
    os.setgid(NOBODY)
    os.setuid(NOBODY)
    reached = 0
    for name in (path, path + ".fd.sock"):
        kind = socket.SOCK_SEQPACKET if name.endswith(".fd.sock") else socket.SOCK_STREAM
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, kind) as other:
            other.connect(name)
            reached += 1
    for fd in range(3, 60):
        with contextlib.suppress(OSError):
            os.close(os.open(f"/proc/{wire}/fd/{fd}", os.O_RDONLY))
            reached += 1
    os._exit(reached)


def reached_by_another_user(client):
    """How many sockets and buffers another user could open; needs root, to become another."""
    if os.geteuid() != 0:
        print("  (not run as root: another user was not tried)")
        return 0
    path = client.address.removeprefix("unix://")
    child = multiprocessing.get_context("fork").Process(
        target=by_another_user, args=(path, common.pid_of(client))
    )
    child.start()
    child.join()
    return child.exitcode


def main():
    with common.Report("S10 shared memory") as report, common.daemon() as client:
        scene = common.stage(client)
        pid = common.pid_of(client)
        alive = {"slack": False}
        report.figure("frames that changed while held", frames_kept(scene), 0, **alive)
        report.figure("buffers that the client changed", changed_by_client(scene), 0, **alive)
        report.figure("frames changed by another's lies", changed_beside_a_liar(scene), 0, **alive)
        report.figure("mappings that show others' pixels", shown_after_release(scene), 0, **alive)
        report.figure("ranges outside a buffer taken", overflows(scene), 0, **alive)
        report.figure("sound ranges refused", int(named(scene)), 0, **alive)
        report.figure("reached by another user", reached_by_another_user(client), 0, **alive)
        with hg.connect(client.address) as liar:
            lying_words(common.stage(liar))
        frame = scene.render("cam", planes=["position"], labels=False)
        dead = int(common.pid_of(client) != pid or not np.isfinite(frame["position"]).any())
        report.figure("daemons that died", dead, 0, **alive)


if __name__ == "__main__":
    main()
