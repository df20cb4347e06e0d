"""Frames that stay on the GPU, in PyTorch: right, never stale, given back, quick.

usage: .venv/bin/python tests/gpu/frames.py [ROUNDS=200]   (needs an NVIDIA GPU and PyTorch)
Prints a line for each check; ends with 1 if one fails.
"""

import gc
import pathlib
import statistics
import subprocess
import sys
import threading
import time
import weakref

import heliograph as hg
import numpy as np
import torch
from heliograph._wire._proto import types_pb2 as types

ARM = pathlib.Path(__file__).parents[2] / "examples/assets/arm/arm.urdf"
SIZE = (1280, 720)
PLANES = ["beauty", "depth", "instance"]
OPTIONS = {"planes": PLANES, "spp": 1, "max_depth": 4, "progress": False, "labels": False}
results = []


def report(name, good, text):
    results.append(good)
    print(f"{name:34s} {'ok    ' if good else 'FAILED'} {text}", flush=True)


def build(client):
    scene = client.create_scene()
    rng = np.random.default_rng(1)
    with scene.edit() as edit:
        edit.dome(color=(0.6, 0.7, 1))
        edit.mesh("ball", **hg.shapes.sphere(0.3, 26))
        for i in range(100):
            edit.entity(f"b{i}", mesh="ball", transform=hg.Pose(rng.uniform(-2, 2, 3)))
        lens = hg.Camera.from_fov(50, *SIZE, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -7, 1), (0, 0, 0)))
    return scene


def look(scene, k=0, **options):
    """The frame with one ball at place k."""
    with scene.overlay() as overlay:
        overlay.entity("b0", transform=hg.Pose((0.01 * k - 1, -2, 0)))
    return scene.render("cam", overlay=overlay, seed=k, **(OPTIONS | options))


def same(frame, host):
    return all(np.array_equal(frame.torch(p).cpu().numpy(), host[p]) for p in PLANES)


def used(client):
    """(bytes of the tenant in the daemon, bytes of the GPU in use by anybody)."""
    free, total = torch.cuda.mem_get_info()
    return client.info().used["tenant_bytes"], total - free


def round_trips(scene, rounds):
    wrong = sum(not same(look(scene, k, device="cuda"), look(scene, k)) for k in range(rounds))
    report("round trips in torch", wrong == 0, f"{wrong} of {rounds} differ from numpy's")
    tensor = look(scene, device="cuda").torch("beauty")
    good = tensor.is_cuda and tensor.shape == (SIZE[1], SIZE[0], 4)
    plane = look(scene, device="cuda").on_device("beauty")
    good = good and torch.from_dlpack(plane).data_ptr() == plane.pointer
    good = good and plane.torch().data_ptr() == plane.pointer
    report("tensors of the same memory", good, f"{tensor.device}, {tuple(tensor.shape)}")


def leased(scene):
    """A frame's beauty as a tensor, and a weak reference to its use of the buffer."""
    plane = look(scene, device="cuda").on_device("beauty")
    return plane.torch(), weakref.ref(plane._lease)


def leases_of(client):
    """How many uses of buffers this process has not given back to the daemon."""
    torch.cuda.synchronize()
    shared = client.connection.link.shared
    shared._give_back_unused()
    return len(shared._leases) + len(shared._in_use) + len(shared._unsent)


def by_dlpack(client, scene):
    """Tensors are DLPack's, and give their lease back when they die, in whatever thread."""
    gc.collect()
    before, array = leases_of(client), hg.DeviceArray
    interface = array.__cuda_array_interface__
    del array.__cuda_array_interface__  # the other way to a tensor
    try:
        tensor, lease = leased(scene)
    finally:
        array.__cuda_array_interface__ = interface
    view = tensor[0, 0]
    del tensor
    held, good = leases_of(client) - before, lease() is not None
    del view
    good = good and held > 0 and lease() is None and leases_of(client) == before
    report("tensors through DLPack", good, f"{held} leases while a view lives, none afterwards")

    kept = [leased(scene)]
    lease = kept[0][1]
    thread = threading.Thread(target=kept.clear)
    thread.start()
    thread.join()
    good = lease() is None
    for _ in range(20):  # backward() frees what it saved in a thread that Python did not start
        tensor, lease = leased(scene)
        weight = torch.ones_like(tensor).requires_grad_()
        loss = (weight * tensor).sum()
        del tensor
        good = good and lease() is not None
        loss.backward()
        good = good and lease() is None
    good = good and leases_of(client) == before
    report("leases that end in other threads", good, "a Python thread's, 20 of autograd's")

    folder = str(pathlib.Path(__file__).resolve().parent)
    code = ENDS.format(folder=folder, address=client.address)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    good = (done.returncode, done.stdout) == (0, "end\n")
    report("Python ends while a tensor lives", good, f"code {done.returncode} {done.stderr[-300:]}")


def worlds(scene):
    poses = np.tile(np.eye(4, dtype="f4"), (50, 1, 1, 1))
    poses[:, 0, :3, 3] = np.random.default_rng(2).uniform(-2, 2, (50, 3))
    asked = hg.Worlds(50).set_transforms("b0", poses)
    options = OPTIONS | {"size": (63, 65)}
    here = scene.render_worlds("cam", asked, **options)
    there = scene.render_worlds("cam", asked, device="cuda", **options)
    shape = tuple(there.torch("beauty").shape)
    good = same(there, here) and shape == (50, 1, 65, 63, 4)
    report("worlds in one tensor a plane", good, f"{shape}")


def latency(scene):
    def seconds(**options):
        def one(k):
            start = time.perf_counter()
            frame = look(scene, k, **options)
            if "device" in options:
                frame.torch("beauty")
                torch.cuda.synchronize()
            return time.perf_counter() - start

        return 1e3 * statistics.median([one(k) for k in range(60)][10:])

    for size in (SIZE, (256, 256), (64, 64)):
        here, there = seconds(size=size), seconds(size=size, device="cuda")
        text = f"overlay to a tensor {there:.2f} ms, to numpy {here:.2f} ms"
        report(f"latency {size[0]}x{size[1]}, 3 planes", True, text)


def memory(client, scene, rounds):
    for k in range(rounds):  # torch loads its programs, and the driver's pool finds its size
        look(scene, k, device="cuda").torch("beauty").sum()
    gc.collect()
    before = used(client)
    for k in range(rounds):
        look(scene, k, device="cuda").torch("beauty").sum()
    gc.collect()
    torch.cuda.synchronize()
    after = used(client)
    text = f"tenant {before[0]} -> {after[0]}, GPU {before[1]} -> {after[1]} bytes"
    report("memory is constant", after[0] == before[0] and after[1] <= before[1] + (2 << 20), text)


def in_flight(scene):
    """Work that waits on another stream reads the frame it was given, whatever is rendered then."""
    expected = torch.from_numpy(look(scene, 50)["beauty"].copy())
    stream = torch.cuda.Stream()
    wrong = 0
    for _ in range(10):
        frame = look(scene, 50, device="cuda")
        with torch.cuda.stream(stream):
            torch.cuda._sleep(200_000_000)
            copy = frame.torch("beauty").clone()
        del frame
        gc.collect()
        for k in range(6):
            look(scene, 60 + k, device="cuda")
        stream.synchronize()
        wrong += not torch.equal(copy.cpu(), expected)
    report("frames that queued work reads", wrong == 0, f"{wrong} of 10 changed")


CHILD = """
import sys, time
sys.path.insert(0, {folder!r})
import heliograph as hg, frames
client = hg.connect({address!r})
scene = frames.build(client)
held = [frames.look(scene, k, device="cuda").torch("beauty") for k in range(10)]
print("ready", flush=True)
time.sleep(600)
"""


ENDS = """
import sys
sys.path.insert(0, {folder!r})
import heliograph as hg, frames
client = hg.connect({address!r})
kept = frames.look(frames.build(client), device="cuda").torch("beauty")
print("end", flush=True)
"""


def poses(client, count=100_000):
    """Transforms of a tensor, against the same from numpy."""
    scene = build(client)
    places = np.tile(np.eye(4, dtype="f4"), (count, 1, 1))
    with scene.edit() as edit:
        group = edit.instances("copy", mesh="ball", transforms=places)
    stream, wrong, took = torch.cuda.Stream(), 0, {"torch": [], "numpy": []}
    for k in range(12):
        with torch.cuda.stream(stream):
            torch.cuda._sleep(20_000_000)
            tensor = torch.eye(4, device="cuda").repeat(count, 1, 1)
            tensor[:, :3, 3] = torch.rand(count, 3, device="cuda") * 40 - 20
            start = time.perf_counter()
            if k >= 2:
                stream.synchronize()
                start = time.perf_counter()
            with scene.edit() as edit:
                edit.set_transforms(group, tensor)
            took["torch"].append(time.perf_counter() - start)
        host = tensor.cpu().numpy()
        wrong += not np.array_equal(scene.transforms(group), host)
        start = time.perf_counter()
        with scene.edit() as edit:
            edit.set_transforms(group, host)
        took["numpy"].append(time.perf_counter() - start)
    there, here = (1e3 * statistics.median(took[k][2:]) for k in ("torch", "numpy"))
    text = f"{count} to a published snapshot {there:.2f} ms, from numpy {here:.2f} ms"
    report("poses of a tensor", wrong == 0, f"{wrong} of 12 wrong; " + text)


def vertices(client, segments=450):
    """A mesh that gets new vertices from a tensor, against the same from numpy."""
    scene = build(client)
    sphere = hg.shapes.sphere(1.0, segments=segments)
    rest = torch.from_numpy(np.asarray(sphere["positions"], dtype="f4")).cuda()
    with scene.edit() as edit:
        edit.mesh("soft/mesh", **sphere)
        edit.entity("soft", mesh="soft/mesh")
    wrong, took = 0, []
    for k in range(12):
        bent = (rest * (1 + 0.1 * torch.sin(rest.roll(1, 1) * 5 + k))).contiguous()
        torch.cuda.synchronize()
        start = time.perf_counter()
        with scene.edit() as edit:
            edit.mesh("soft/mesh", positions=bent)
        took.append(time.perf_counter() - start)
        wrong += not np.array_equal(scene["soft/mesh"].positions, bent.cpu().numpy())
    text = f"{len(rest)} to a published snapshot {1e3 * statistics.median(took[2:]):.2f} ms"
    report("vertices of a tensor", wrong == 0, f"{wrong} of 12 wrong; " + text)


def joints(client, count=1024):
    """Robots, of a scene and of worlds, that joint values of a tensor move, against numpy's."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            arm = edit.import_urdf(ARM)
            edit.dome(color=1.0)
            lens = hg.Camera.from_fov(50, 48, 32, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((2, -2, 1), (0, 0, 0.4)))
        low, high = np.clip(arm.limits, -1, 1).T
        rows = np.random.default_rng(0).uniform(low, high, (count, len(low)))
        poses, pictures, took = [], [], []
        for values in (rows, torch.from_numpy(rows).cuda()):
            with scene.edit() as edit:
                edit.set_joints(arm, values[0])
            poses.append(scene.transforms(arm.moving))
            for _ in range(3):  # the first makes room
                start = time.perf_counter()
                worlds = hg.Worlds(count).set_joints(arm, values)
                seconds = time.perf_counter() - start
                frame = scene.render_worlds("cam", worlds, planes=["depth"])
            pictures.append(frame["depth"])
            took.append(1e3 * seconds)
        try:
            hg.Worlds(count).set_joints(arm, torch.from_numpy(rows + 9).cuda())
            error_text = ""
        except hg.InvalidArgument as error:
            error_text = str(error)
    apart = float(np.abs(poses[1] - poses[0]).max())
    differ = float(np.mean(pictures[1] != pictures[0]))
    good = apart < 1e-6 and differ < 1e-2 and error_text.startswith("values[0]: joint")
    text = f"poses apart by {apart:.1e}, {differ:.1e} of the depths differ; {count} robots "
    report("joints of a tensor", good, text + f"{took[1]:.2f} ms, from numpy {took[0]:.2f} ms")


def killed_client(client):
    before = used(client)
    folder = str(pathlib.Path(__file__).resolve().parent)
    code = CHILD.format(folder=folder, address=client.address)
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    child.stdout.readline()
    held = used(client)
    child.kill()
    child.wait()
    start = time.monotonic()
    kept = before[0] + (1 << 20)  # what the device keeps of the scenes that it showed last
    while used(client)[0] > kept and time.monotonic() < start + 30:
        time.sleep(0.05)
    took = time.monotonic() - start
    after = used(client)
    good = after[0] <= kept < held[0]
    text = f"{held[0] - before[0]} bytes of leases gone after {took:.1f} s; GPU {before[1]} -> "
    report("a client that is killed", good, text + f"{held[1]} -> {after[1]} bytes")


def others(client, scene):
    """Checks that another session or kind of client gets nothing of this one's buffers."""
    held = look(scene, device="cuda")
    buffer = next(iter(client.connection.link.shared._maps))
    with hg.connect(client.address) as other:
        mine = build(other)
        array = types.Array(dtype=types.D_TYPE_F32, shape=[1, 4, 4])
        array.buffer.CopyFrom(types.BufferRef(buffer=buffer, size=64))
        try:
            with mine.edit() as edit:
                edit.instances("copies", mesh="ball", transforms=np.eye(4)[None])
                edit.transaction.edits[-1].instances.matrices.CopyFrom(array)
            refused = False
        except hg.NotFound:
            refused = True
        theirs = look(mine, 3, device="cuda")
        alone = theirs.on_device("beauty").pointer != held.on_device("beauty").pointer
    report("buffers of another session", refused and alone, "cannot be named")
    with hg.connect() as cpu:
        try:
            look(build(cpu), device="cuda")
            text = "was rendered"
        except hg.FailedPrecondition as error:
            text = str(error)
    report("a daemon without the GPU", "--backend cuda" in text, text[:70])


def main(rounds):
    torch.zeros(1).cuda()
    arguments = ["--backend", "cuda", "--grace", "1"]
    with hg.connect(arguments=arguments) as client:
        scene = build(client)
        round_trips(scene, rounds)
        by_dlpack(client, scene)
        worlds(scene)
        in_flight(scene)
        latency(scene)
        memory(client, scene, rounds)
        poses(client)
        vertices(client)
        joints(client)
        killed_client(client)
        others(client, scene)
    sys.exit(not all(results))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
