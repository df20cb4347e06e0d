"""Trees that the GPU builds: pictures against the CPU's, and what it costs to move everything.

usage: .venv/bin/python tests/gpu/builders.py [COUNT...=1000 10000 100000]   (needs an NVIDIA GPU)
Balls of 1,280 triangles of several sizes stand in a cube. All are moved, time and again; then the
centre planes must equal the CPU's but for 1 pixel of 20,000 (edges; more of them beyond 1,000
balls), mean colours must agree within
0.1 %, and the picture must repeat bit for bit. Some more move while the shutter is open.
The same of sheets that deform by morph targets, or get new vertices. Prints a line for each; ends
with 1 if one fails.
"""

import statistics
import sys
import time

import heliograph as hg
import numpy as np

SIZE, SPP, ROUNDS, MOVERS = (640, 480), 16, 7, 200
CENTRES = ["instance", "primitive", "depth"]
EDGES, MEAN = 1 / 20000, 1e-3


def sheet(side):
    """2 * side * side triangles with two morph targets."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, side + 1), np.linspace(-0.5, 0.5, side + 1))
    flat = np.stack([u, v, 0 * u], -1).reshape(-1, 3).astype("f4")
    waves = [np.sin(20 * u) * np.cos(15 * v), np.cos(30 * u * v) * u]
    morphs = np.zeros((2, *flat.shape), "f4")
    for morph, wave in zip(morphs, waves, strict=True):
        morph[:, 2] = 0.1 * wave.reshape(-1)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    right, up = corner + 1, corner + side + 1
    quads = np.stack([corner, right, up, right, up + 1, up], -1)
    return {"positions": flat, "indices": quads.reshape(-1, 3), "morph_positions": morphs}


def poses(count, turn):
    rng = np.random.default_rng(turn)
    half = count ** (1 / 3) / 2
    made = np.tile(np.eye(4, dtype="f4"), (count, 1, 1))
    made[:, :3, :3] *= rng.uniform(0.3, 1.3, (count, 1, 1))
    made[:, :3, 3] = rng.uniform(-half, half, (count, 3))
    return made


def furnish(scene, count):
    """Returns the balls."""
    half = count ** (1 / 3) / 2
    with scene.edit() as edit:
        edit.dome(np.random.default_rng(0).random((8, 16, 3)).astype("f4"))
        mesh = edit.mesh("ball", **hg.shapes.sphere(0.35, 26))
        edit.material("paint", base_color=(0.7, 0.4, 0.2), roughness=0.4)
        balls = edit.instances("b", mesh=mesh, material="paint", transforms=poses(count, 0))
        lens = hg.Camera.from_fov(50, *SIZE, degrees=True, shutter=(0, 0.5))
        eye = (-3.1 * half, -2.3 * half, 1.7 * half)
        for i, at in enumerate(poses(MOVERS, ROUNDS + 1)[:, :3, 3]):
            ways = {0: hg.Pose(at), 0.5: hg.Pose(at + (0.3, 0.1 * (i % 3), 0.2))}
            edit.entity(f"mover/{i}", mesh=mesh, material="paint", keys=ways)
        edit.entity("camera", camera=lens, transform=hg.look_at(eye, (0.01, 0.02, 0.03)))
    return balls


def move(scene, balls, turn):
    with scene.edit() as edit:
        edit.set_transforms(balls, poses(len(balls), turn), teleport=True)


def differing(gpu, cpu):
    """The largest part of pixels where a centre plane is not the same."""
    worst = 0.0
    for plane in CENTRES:
        a, b = np.asarray(gpu[plane], "f8"), np.asarray(cpu[plane], "f8")
        same = np.isclose(a, b, rtol=1e-3, equal_nan=True).reshape(SIZE[1], SIZE[0], -1).all(-1)
        worst = max(worst, float((~same).mean()))
    return worst


def rendered(scene, spp=SPP):
    planes = ["beauty", *CENTRES]
    return scene.render(
        "camera", planes=planes, spp=spp, seed=3, max_depth=4, labels=False, progress=False
    )


def hang(scene, shape):
    with scene.edit() as edit:
        edit.dome(np.random.default_rng(0).random((8, 16, 3)).astype("f4"))
        edit.mesh("sheet/mesh", **shape)
        edit.material("cloth", base_color=(0.2, 0.4, 0.7), roughness=0.6)
        edit.entity("sheet", mesh="sheet/mesh", material="cloth", morph_weights=(0, 0))
        lens = hg.Camera.from_fov(50, *SIZE, degrees=True)
        edit.entity("camera", camera=lens, transform=hg.look_at((0.3, -0.8, 0.7), (0, 0, 0)))


def weights(turn):
    return 1 - 0.1 * turn, 0.15 * turn


def bend(scene, turn, _):
    with scene.edit() as edit:
        edit.entity("sheet", morph_weights=weights(turn))


def reshape(scene, turn, shape):
    """New vertices for a mesh that keeps its triangles."""
    morphs = zip(weights(turn), shape["morph_positions"], strict=True)
    positions = shape["positions"] + sum(np.float32(weight) * morph for weight, morph in morphs)
    with scene.edit() as edit:
        edit.mesh("sheet/mesh", positions=positions)


def check_sheet(gpu, cpu, side, change=bend):
    """The same of a mesh that deforms."""
    inside, shape = [], sheet(side)
    with gpu.create_scene() as there, cpu.create_scene() as here:
        hang(there, shape)
        hang(here, shape)
        for turn in range(1, ROUNDS + 1):
            change(there, turn, shape)
            frame = there.render("camera", spp=1, size=(64, 64), progress=False)
            inside.append(frame.render_seconds)
        change(here, ROUNDS, shape)
        first, again, reference = rendered(there), rendered(there), rendered(here)
    repeats = all((first[p] == again[p]).all() for p in ("beauty", "instance"))
    edges = differing(first, reference)
    ok = repeats and edges <= EDGES
    print(
        f"{'ok' if ok else 'FAILED'} a sheet of {2 * side * side} triangles, {change.__name__}: "
        f"{statistics.median(inside) * 1e3:.1f} ms in the renderer; repeats {repeats}, pixels "
        f"that differ {edges:.1e}; {first.render_seconds * 1e3:.1f} ms of {SPP} samples",
        flush=True,
    )
    return ok


def check(gpu, cpu, count):
    """True if all is as it should be; prints a line."""
    took, uploaded, inside = [], [], []
    with gpu.create_scene() as there, cpu.create_scene() as here:
        balls, ours = furnish(there, count), furnish(here, count)
        rendered(there, 1)
        for turn in range(1, ROUNDS + 1):
            before = gpu.info().uploaded_bytes
            start = time.perf_counter()
            move(there, balls, turn)
            edited = time.perf_counter()
            frame = there.render("camera", spp=1, size=(64, 64), progress=False)
            took.append((edited - start, time.perf_counter() - edited))
            inside.append(frame.render_seconds)
            uploaded.append(gpu.info().uploaded_bytes - before)
        move(here, ours, ROUNDS)
        first, again, reference = rendered(there), rendered(there), rendered(here)
    repeats = all((first[p] == again[p]).all() for p in ("beauty", "instance"))
    edges = differing(first, reference)
    means = [float(np.mean(f["beauty"])) for f in (first, reference)]
    mean = abs(means[0] / means[1] - 1)
    most = EDGES * max(1, count / 1000) ** (1 / 3)  # the edges that a ray passes
    ok = repeats and edges <= most and mean <= MEAN
    edit, frame = (statistics.median(side) * 1e3 for side in zip(*took, strict=True))
    print(
        f"{'ok' if ok else 'FAILED'} {count}: all moved {edit:.1f} ms, then a frame {frame:.1f} ms "
        f"({statistics.median(inside) * 1e3:.2f} ms in the renderer), "
        f"{statistics.median(uploaded) / 1e6:.2f} MB uploaded; repeats {repeats}, "
        f"pixels that differ {edges:.1e}, means {mean:.1e}; "
        f"{first.render_seconds * 1e3:.1f} ms of {SPP} samples",
        flush=True,
    )
    return ok


def main(counts):
    with (
        hg.connect(arguments=["--backend", "cuda"]) as gpu,
        hg.connect(arguments=["--backend", "embree"]) as cpu,
    ):
        results = [check(gpu, cpu, count) for count in counts]
        results += [check_sheet(gpu, cpu, side) for side in (20, 100, 708)]
        results += [check_sheet(gpu, cpu, side, reshape) for side in (20, 708)]
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main([int(each) for each in sys.argv[1:]] or [1000, 10_000, 100_000])
