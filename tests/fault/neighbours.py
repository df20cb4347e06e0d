"""Data of one client holds up no other: frames of a small client alone, and beside a process
that brings and renders a mesh of 5 million triangles, a dome of 8k, a volume of 1 GB, textures of
4k, sensor frames of 1080p or 60 pictures of 25 Mpixel to decode; the daemon is ready throughout.
And 100 scenes in turn cost what one does, while they have room.

usage: neighbours.py [--short], or by itself: neighbours.py --bring NAME ADDRESS [--short]
"""

import concurrent.futures
import pathlib
import subprocess
import sys
import tempfile
import time
import urllib.request

import common
import decodes
import health
import heliograph as hg
import numpy as np
import served

MESH = common.size(1600, 500)  # vertices along a side
DOME = common.size(4096, 1024)  # rows
VOXELS = common.size(640, 128)  # along a side
TEXTURE = 4096
SENSOR = (1920, 1080) if not common.SHORT else (800, 600)
FRAMES = common.size(10, 2)  # with the sensor
PICTURES = common.size(60, 4)
SIDE = common.size(5000, 1500)  # pixels of a picture, each way
SCENES = common.size(100, 12)
QUIET = 20  # frames' time within which a wait is lost in noise


def bring_mesh(scene):
    n = MESH
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    z = np.random.default_rng(1).random((n, n))
    a = (x[:-1, :-1] * n + y[:-1, :-1]).ravel()
    two = [np.stack([a, a + n, a + 1], -1), np.stack([a + 1, a + n, a + n + 1], -1)]
    positions = np.stack([x, y, z], -1).reshape(-1, 3).astype("f4")
    yield
    with scene.edit() as edit:
        indices = np.concatenate(two).astype("u4")
        edit.entity("field", mesh=edit.mesh("field", positions=positions, indices=indices))
    scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_dome(scene):
    sky = np.random.default_rng(0).random((DOME, 2 * DOME, 3)).astype("f2")
    yield
    with scene.edit() as edit:
        edit.dome(sky)
    scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_volume(scene):
    smoke = np.random.default_rng(0).random((VOXELS,) * 3, dtype="f4")
    yield
    with scene.edit() as edit:
        volume = edit.volume("smoke", density=smoke, voxel_size=1 / VOXELS)
        edit.entity("cloud", volume=volume)
    scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_texture(scene):
    image = np.random.default_rng(0).integers(0, 255, (TEXTURE, TEXTURE, 3)).astype("u1")
    yield
    with scene.edit() as edit:
        edit.material("painted", base_color=edit.texture("picture", image))
        edit.entity("ball", material="painted")
    scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_sensor(scene):
    sensor = hg.RgbSensor(full_well=10000, read_noise=3, bits=12)
    with scene.edit() as edit:
        lens = hg.Camera.from_fov(50, *SENSOR, degrees=True, rgb_sensor=sensor)
        edit.entity("cam", camera=lens)
    yield
    for _ in range(FRAMES):
        scene.render("cam", spp=1, planes=["sensor_rgb"], labels=False)


def bring_decodes(scene):
    with tempfile.TemporaryDirectory() as folder:
        paths = [pathlib.Path(folder) / f"{i}.png" for i in range(PICTURES)]
        for i, path in enumerate(paths):
            path.write_bytes(decodes.picture(SIDE, i))
        yield
        with concurrent.futures.ThreadPoolExecutor(min(PICTURES, 32)) as pool:
            list(pool.map(lambda path: decodes.seconds_of(scene.client, path), paths))


def bring(name, address):
    """Prints "ready", waits for a line, brings something, and prints how long that took."""
    with hg.connect(address) as client:
        steps = globals()[f"bring_{name}"](common.stage(client, 64, 64))
        next(steps)
        print("ready", flush=True)
        sys.stdin.readline()
        start = time.perf_counter()
        next(steps, None)
        print(time.perf_counter() - start, flush=True)


def small(scene, i):
    """A frame after an edit that brings a mesh of its own."""
    with scene.edit() as edit:
        edit.mesh("mesh", **hg.shapes.sphere(0.5 + 0.001 * (i % 100), segments=8))
    start = time.perf_counter()
    scene.render("cam", spp=1, planes=["beauty"], labels=False)
    return time.perf_counter() - start


def alone(scene, seconds):
    took, until = [], time.perf_counter() + seconds
    while time.perf_counter() < until:
        took.append(small(scene, len(took)))
    return took


def beside(scene, is_done):
    """Seconds of each frame that began while a neighbour worked."""
    took = []
    while not is_done():
        took.append(small(scene, len(took)))
    return took


def judge(report, name, times):
    quiet, theirs, took = times
    fair = 2 * common.percentile(quiet, 0.99)
    late = common.percentile(took, 0.99)
    print(f"    {name}, {1000 * theirs:.0f} ms: alone p99 {500 * fair:.1f} ms,", end=" ")
    print(f"beside it {1000 * late:.1f} ms ({len(took)})")
    share = max(took) / max(theirs, QUIET * fair)
    report.figure(f"{name}: longest frame, share of its time", share, 0.5, slack=False)
    if not common.SHORT:
        report.figure(f"{name}: p99 over fair share's time", late / fair, 1.5)


def beside_a_process(scene, name, address):
    program = [sys.executable, __file__, *sys.argv[1:], "--bring", name, address]
    pipe = subprocess.PIPE
    with subprocess.Popen(program, stdin=pipe, stdout=pipe, text=True) as neighbour:
        if neighbour.stdout.readline() != "ready\n":
            raise RuntimeError(f"{name}: the neighbour ended before it was ready")
        quiet = alone(scene, common.size(5, 0.5))
        print(file=neighbour.stdin, flush=True)
        took = beside(scene, lambda: neighbour.poll() is not None)
        return quiet, float(neighbour.stdout.readline()), took


def beside_a_scene(scene, other):
    """The same client's: its sensor frames in another thread."""
    steps = bring_sensor(other)
    next(steps)
    quiet = alone(scene, common.size(5, 0.5))
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        start = time.perf_counter()
        work = pool.submit(next, steps, None)
        took = beside(scene, work.done)
        work.result()
        return quiet, time.perf_counter() - start, took


def neighbours(client, report):
    scene = common.stage(client, 64, 64)
    watch = health.Health(client).watch()
    for name in ("mesh", "dome", "volume", "texture", "sensor", "decodes"):
        judge(report, name, beside_a_process(scene, name, client.address))
    others = beside_a_scene(scene, common.stage(client, 64, 64))
    judge(report, "sensor of the client's other scene", others)
    report.figure("times not ready", sum(not ready for _, ready in watch.seen), 0, slack=False)
    watch.close()


def crowd(client, count, static):
    """Scenes of many things, with a mesh of each its own."""
    scenes = []
    for i in range(count):
        scene = client.create_scene()
        with scene.edit() as edit:
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.3 + 0.001 * i))
            poses = np.tile(np.eye(4), (40, 1, 1))
            poses[:, :3, 3] = np.random.default_rng(i).uniform(-4, 4, (40, 3))
            edit.instances("thing", mesh=mesh, transforms=poses, static=static)
            lens = hg.Camera.from_fov(60, 256, 256, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -12, 4), (0, 0, 0)))
        scenes.append(scene)
    return scenes


def in_turn(scenes, flow, rounds):
    """The median of the seconds of a frame, scene after scene."""
    planes = ["beauty", "flow_forward", "flow_backward"] if flow else ["beauty"]
    options = {"frame_interval": 0.04, "hold": True} if flow else {}
    took = []
    for _ in range(rounds):
        for scene in scenes:
            start = time.perf_counter()
            scene.render("cam", spp=1, planes=planes, labels=False, **options)
            took.append(time.perf_counter() - start)
    return common.percentile(took[len(scenes) :], 0.5)


def made_again(daemon):
    """Scenes that were made again, as there had been no room to keep them."""
    name = "heliograph_scenes_made_again_total "
    with urllib.request.urlopen(f"http://{daemon.metrics}/metrics", timeout=5) as reply:
        lines = reply.read().decode().splitlines()
    return float(next(line for line in lines if line.startswith(name))[len(name) :])


def turns(client, report):
    for static in (False, True):
        scenes = crowd(client, SCENES, static)
        for flow in (False, True):
            one = in_turn(scenes[:1], flow, 40)
            all_of_them = in_turn(scenes, flow, 3)
            name = f"{'static' if static else 'moving'}{', flow' if flow else ''}"
            print(f"    {name}: one {1000 * one:.2f} ms, in turn {1000 * all_of_them:.2f} ms")
            if not common.SHORT:
                report.figure(f"{SCENES} scenes in turn, {name}", all_of_them / one, 1.2)


def main():
    if "--bring" in sys.argv:
        return bring(*sys.argv[sys.argv.index("--bring") + 1 :][:2])
    with common.Report("neighbours") as report:
        with common.daemon() as client:
            neighbours(client, report)
        with served.served("--metrics", "127.0.0.1:0") as daemon:
            with hg.connect(daemon.socket) as client:
                turns(client, report)
            report.figure("scenes made again", made_again(daemon), 0, slack=False)


if __name__ == "__main__":
    main()
