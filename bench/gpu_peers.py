"""W1-W5 at 1280x720 on one GPU, beside Mitsuba 3 (cuda_ad_rgb): time and error of a picture.

usage: gpu_peers.py BUNDLE MITSUBA [options]
BUNDLE is where scripts/bundle's archive was unpacked, MITSUBA a folder with the packages mitsuba,
drjit and OpenEXR for the Python that runs this, which has numpy. Ends with 1 if a renderer fails.

Times are of one picture of --spp samples, the median of --pictures; the first, which compiles and
records, is apart. "kernels" ends when the picture is in the GPU's memory (Mitsuba: recorded
frames, launched and awaited) or, for us, in the daemon's; "numpy" when it is in the caller's.

The error is against the means of all other pictures, a of the same renderer and b of the other: of
a picture x, (x - a)(x - b) / (((a + b) / 2)^2 + 0.01), whose expectation is the variance of x,
whatever noise the means have and however the renderers differ, without the 0.1 % of the pixels
where it is largest. Errors are with Lambert in place of principled materials, like the pictures
that are compared; times are of both.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "peers"))
import common  # noqa: E402
import numpy as np  # noqa: E402

RENDERERS = ("heliograph", "mitsuba")
KEPT = 3  # pictures whose error is measured


class Ours:
    def __init__(self, doc, options):
        import heliograph as hg
        from heliograph_scene import Heliograph

        client = hg.connect(arguments=["--backend", options.backend])
        self.peer = Heliograph(client, doc)
        self.version = self.peer.version

    def picture(self, size, spp, seed):
        """The pixels, and seconds until the daemon has them."""
        peer = self.peer
        frame = peer.scene.render(peer.cameras[size], spp=spp, seed=seed, **peer.options)
        return frame["beauty"][..., :3], frame.render_seconds


class Theirs:
    def __init__(self, doc, options):
        from mitsuba_peer import Mitsuba

        settings = {"flat": False, "instance_all": False, "no_freeze": False}
        threads = os.cpu_count()
        self.peer = Mitsuba(
            doc, argparse.Namespace(variant=options.variant, threads=threads, **settings)
        )
        self.version = self.peer.version

    def picture(self, size, spp, seed):
        """The pixels, and seconds until the kernels are done."""
        import drjit as dr

        start = time.perf_counter()
        image = self.peer.start(size, spp, seed)
        dr.eval(image)
        dr.sync_thread()
        seconds = time.perf_counter() - start
        return np.array(image)[..., :3], seconds


def child(options):
    """Runs one renderer on one workload: times as a line, pictures in a file."""
    begin = time.perf_counter()
    doc = common.load_scene(str(options.work / "scenes" / options.child[1]), options.lambert)
    renderer = (Ours if options.child[0] == "heliograph" else Theirs)(doc, options)
    result = {"version": renderer.version, "load": time.perf_counter() - begin}
    begin = time.perf_counter()
    for seed in range(2):  # the second may record, too
        renderer.picture(options.size, options.spp, seed)
    result["first"] = time.perf_counter() - begin
    total = squares = 0.0
    kept, kernels, whole = [], [], []
    for seed in range(options.pictures):
        begin = time.perf_counter()
        image, seconds = renderer.picture(options.size, options.spp, 1000 + seed)
        whole.append(time.perf_counter() - begin)
        kernels.append(seconds)
        total, squares = total + image.astype("f8"), squares + image.astype("f8") ** 2
        if seed < KEPT:
            kept.append(image)
    mean = total / options.pictures
    variance = np.maximum(squares / options.pictures - mean**2, 0) / (options.pictures - 1)
    result |= {"kernels": kernels, "whole": whole, "mean": float(mean.mean())}
    if options.lambert:
        path = options.work / "{1}_{0}.npz".format(*options.child)
        np.savez(path, mean=mean, variance=variance, kept=np.array(kept))
    print("RESULT " + json.dumps(result), flush=True)
    os._exit(0)  # the teardown belongs to no figure


def trimmed_error(x, own, other, count):
    """Error of one of the `count` pictures that `own` is the mean of, without the worst 0.1 % of
    values."""
    a, b = (count * own - x) / (count - 1), other
    relative = ((x - a) * (x - b) / (((a + b) / 2) ** 2 + 1e-2)).mean(-1).ravel()
    return float(np.sort(relative)[: int(len(relative) * 0.999)].mean())


def compare(work, workload, count):
    """Errors of both renderers, and how far their means agree."""
    ours, theirs = (np.load(work / f"{workload}_{name}.npz") for name in RENDERERS)
    found = {}
    for name, own, other in zip(RENDERERS, (ours, theirs), (theirs, ours), strict=True):
        errors = [trimmed_error(x, own["mean"], other["mean"], count) for x in own["kept"]]
        found[name] = statistics.mean(errors)
    both = ours["variance"] + theirs["variance"]
    z = (ours["mean"] - theirs["mean"]) / np.sqrt(np.maximum(both, 1e-12))
    found["difference"] = float(ours["mean"].mean() / theirs["mean"].mean() - 1)
    found["its_error"] = float(np.sqrt(both.sum()) / both.size / theirs["mean"].mean())
    found["z_above_2"] = float(np.mean(abs(z) > 2))
    return found


def environment(options, renderer):
    own = {"PYTHONPATH": str(options.mitsuba)}
    if renderer == "heliograph":
        own["PYTHONPATH"] = str(options.bundle / "python")
        own["HELIOGRAPHD"] = str(options.bundle / "bin/heliographd")
        own["HELIOGRAPH_DECODE"] = str(options.bundle / "bin/heliograph-decode")
    inherited = os.environ.get("PYTHONPATH")
    own["PYTHONPATH"] += os.pathsep + inherited if inherited else ""
    return {**os.environ, **own}


def run(options, renderer, workload, lambert):
    """The RESULT of a child, or None."""
    more = ["--lambert"] if lambert else ["--pictures", "3"]
    command = [sys.executable, __file__, *sys.argv[1:], "--child", renderer, workload, *more]
    environ = environment(options, renderer)
    begin = time.monotonic()
    try:
        done = subprocess.run(
            command, env=environ, capture_output=True, text=True, timeout=options.patience
        )
        output, why = done.stdout, done.stderr[-1500:]
    except subprocess.TimeoutExpired:
        output, why = "", f"over {options.patience} s"
    lines = [line for line in output.splitlines() if line.startswith("RESULT ")]
    materials = "Lambert" if lambert else "principled"
    took = time.monotonic() - begin
    if not lines:
        print(f"{workload} {renderer} {materials}: FAILED after {took:.0f} s\n{why}", flush=True)
        return None
    result = json.loads(lines[-1].removeprefix("RESULT "))
    ms = statistics.median(result["kernels"]) * 1e3
    print(
        f"{workload} {renderer:10s} {materials:10s} {took:5.1f} s: load {result['load']:.1f}, "
        f"first {result['first']:.1f}, kernels {ms:.1f} ms, mean {result['mean']:.5f}",
        flush=True,
    )
    return result


def table(options, results, agreement):
    """Table for docs/performance.md: workloads across, both renderers in a cell."""
    samples = options.size[0] * options.size[1] * options.spp
    names = options.workloads

    def cells(value, form):
        """`value` of both; what is missing is a dash."""
        found = []
        for name in names:
            try:
                found.append("; ".join(form.format(value(name, each)) for each in RENDERERS))
            except (KeyError, TypeError):
                found.append("-")
        return found

    def seconds(name, each, kind="kernels", lambert=True):
        return statistics.median(results[name, each, lambert][kind])

    def efficiency(name, each):
        return 1 / (agreement[name][each] * seconds(name, each))

    def rate(lambert):
        return lambda name, each: samples / seconds(name, each, lambert=lambert) / 1e6

    def alone(value, form):
        return [form.format(value(name)) if name in agreement else "-" for name in names]

    rows = [
        ("M samples/s, Lambert", cells(rate(True), "{:.0f}")),
        ("M samples/s, principled", cells(rate(False), "{:.0f}")),
        ("ms a picture, Lambert: kernels", cells(lambda n, e: seconds(n, e) * 1e3, "{:.1f}")),
        ("the same in numpy", cells(lambda n, e: seconds(n, e, "whole") * 1e3, "{:.1f}")),
        ("load, s", cells(lambda n, e: results[n, e, True]["load"], "{:.1f}")),
        ("first pictures, s", cells(lambda n, e: results[n, e, True]["first"], "{:.1f}")),
        ("trimmed relMSE", cells(lambda n, e: agreement[n][e], "{:.5f}")),
        ("efficiency", cells(efficiency, "{:.0f}")),
        (
            "ratio of the efficiencies",
            alone(lambda n: efficiency(n, RENDERERS[0]) / efficiency(n, RENDERERS[1]), "{:.2f}"),
        ),
        ("difference of the mean", alone(lambda n: 100 * agreement[n]["difference"], "{:+.3f} %")),
        ("its standard error", alone(lambda n: 100 * agreement[n]["its_error"], "{:.3f} %")),
        ("pixels with z above 2", alone(lambda n: 100 * agreement[n]["z_above_2"], "{:.1f} %")),
    ]
    versions = sorted({result["version"] for result in results.values()})
    head = f"{options.size[0]}x{options.size[1]}, {options.spp} samples per pixel"
    lines = [f"{head}; " + "; ".join(versions) + "; ours first in each cell", ""]
    lines += ["| | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(values) + " |" for name, values in rows]
    return "\n".join(lines)


def parse():
    parser = argparse.ArgumentParser(prog="gpu_peers.py")
    parser.add_argument("bundle", type=pathlib.Path)
    parser.add_argument("mitsuba", type=pathlib.Path)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/gpu_peers"))
    parser.add_argument("--backend", default="cuda")
    parser.add_argument("--variant", default="cuda_ad_rgb")
    parser.add_argument("--size", default="1280x720", choices=["1280x720", "256x256", "192x108"])
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--pictures", type=int, default=16)
    parser.add_argument("--workloads", nargs="+", default=["W1", "W2", "W3", "W4", "W5"])
    parser.add_argument("--limit", type=float, default=380, help="s: nothing begins after that")
    parser.add_argument("--patience", type=float, default=120, help="s, of one renderer's run")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--lambert", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.size = tuple(map(int, options.size.split("x")))
    options.work, options.bundle, options.mitsuba = (
        path.resolve() for path in (options.work, options.bundle, options.mitsuba)
    )
    return options


def make_scenes(options):
    scenes = options.work / "scenes"
    if not (scenes / "W5/scene.json").exists():
        environ = environment(options, "mitsuba")
        command = [sys.executable, str(HERE / "make_scenes.py"), str(scenes)]
        subprocess.run(command, env=environ, check=True)


def main(options):
    begin = time.monotonic()
    options.work.mkdir(parents=True, exist_ok=True)
    make_scenes(options)
    results, agreement, failed = {}, {}, False
    for lambert in (True, False):
        for workload in options.workloads:
            if time.monotonic() - begin > options.limit:
                print(f"{workload}: left out, as {options.limit:.0f} s have passed", flush=True)
                failed = True
                continue
            found = {each: run(options, each, workload, lambert) for each in RENDERERS}
            failed = failed or None in found.values()
            results |= {(workload, e, lambert): r for e, r in found.items() if r}
            if lambert and None not in found.values():
                agreement[workload] = compare(options.work, workload, options.pictures)
    text = table(options, results, agreement)
    print(f"\n{text}\n\n{time.monotonic() - begin:.0f} s")
    (options.work / "table.md").write_text(text + "\n")
    sys.exit(failed)


if __name__ == "__main__":
    chosen = parse()
    child(chosen) if chosen.child else main(chosen)
