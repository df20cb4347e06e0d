"""What one client brings holds up no other: frames of a small client alone, and beside a neighbour
that brings a mesh of 5 million triangles, a dome of 8k, textures of 4k or sensor frames of 1080p;
the daemon is ready throughout. And 100 scenes in turn cost what one does, while they have room."""

import threading
import time
import urllib.request

import common
import health
import heliograph as hg
import numpy as np
import served

MESH = common.size(1600, 500)  # vertices along a side
DOME = common.size(4096, 1024)  # rows
TEXTURE = 4096
SENSOR = (1920, 1080) if not common.SHORT else (800, 600)
SCENES = common.size(100, 12)
QUIET = 20  # frames' time within which nobody can tell a wait from noise


def grid(n):
    """A height field of 2 (n - 1)^2 triangles."""
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    z = np.random.default_rng(1).random((n, n))
    a = (x[:-1, :-1] * n + y[:-1, :-1]).ravel()
    two = [np.stack([a, a + n, a + 1], -1), np.stack([a + 1, a + n, a + n + 1], -1)]
    positions = np.stack([x, y, z], -1).reshape(-1, 3).astype("f4")
    return {"positions": positions, "indices": np.concatenate(two).astype("u4")}


def bring_mesh(scene):
    field = grid(MESH)
    with scene.edit() as edit:
        edit.entity("field", mesh=edit.mesh("terrain", **field))
    return lambda: scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_dome(scene):
    sky = np.random.default_rng(0).random((DOME, 2 * DOME, 3)).astype("f2")
    with scene.edit() as edit:
        edit.dome(sky)
    return lambda: scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_texture(scene):
    image = np.random.default_rng(0).integers(0, 255, (TEXTURE, TEXTURE, 3)).astype("u1")
    with scene.edit() as edit:
        edit.material("painted", base_color=edit.texture("picture", image))
        edit.entity("ball", material="painted")
    return lambda: scene.render("cam", spp=1, planes=["beauty"], labels=False)


def bring_sensor(scene):
    sensor = hg.RgbSensor(full_well=10000, read_noise=3, bits=12)
    with scene.edit() as edit:
        lens = hg.Camera.from_fov(50, *SENSOR, degrees=True, rgb_sensor=sensor)
        edit.entity("cam", camera=lens)
    scene.render("cam", spp=1, planes=["beauty"], labels=False)
    return lambda: scene.render("cam", spp=1, planes=["sensor_rgb"], labels=False)


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


def beside(scene, work):
    """Seconds of a neighbour's frame, and of each frame that began while it was made."""
    start = time.perf_counter()
    ends = []
    neighbour = threading.Thread(target=lambda: (work(), ends.append(time.perf_counter())))
    neighbour.start()
    took = []
    while neighbour.is_alive():
        took.append(small(scene, len(took)))
    neighbour.join()
    return ends[0] - start, took


def neighbours(client, report):
    scene = common.stage(client, 64, 64)
    watch = health.Health(client).watch()
    for bring in (bring_mesh, bring_dome, bring_texture, bring_sensor):
        name = bring.__name__.removeprefix("bring_")
        with hg.connect(client.address) as other:
            judge(report, name, scene, bring(common.stage(other, 64, 64)))
    own = bring_sensor(common.stage(client, 64, 64))
    judge(report, "sensor of another scene of the client", scene, own)
    report.figure("times not ready", sum(not ready for _, ready in watch.seen), 0, slack=False)
    watch.close()


def judge(report, name, scene, work):
    quiet = alone(scene, common.size(5, 0.5))
    theirs, took = beside(scene, work)
    fair = 2 * common.percentile(quiet, 0.99)
    late = common.percentile(took, 0.99)
    print(f"    {name}, {1000 * theirs:.0f} ms: alone p99 {500 * fair:.1f} ms,", end=" ")
    print(f"beside it {1000 * late:.1f} ms ({len(took)})")
    share = max(took) / max(theirs, QUIET * fair)
    report.figure(f"{name}: longest frame, share of its time", share, 0.5, slack=False)
    if not common.SHORT:
        report.figure(f"{name}: p99 over fair share's time", late / fair, 1.5)


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
            lens = hg.Camera.from_fov(60, 64, 64, degrees=True)
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
    with common.Report("neighbours") as report:
        with common.daemon() as client:
            neighbours(client, report)
        with served.served("--metrics", "127.0.0.1:0") as daemon:
            with hg.connect(daemon.socket) as client:
                turns(client, report)
            report.figure("scenes made again", made_again(daemon), 0, slack=False)


if __name__ == "__main__":
    main()
