"""The plane `denoised` on the GPU: as the CPU makes it, repeated, in the device's memory, quick.

usage: .venv/bin/python tests/gpu/denoise.py   (needs an NVIDIA GPU and Open Image Denoise)
Prints a line for each check; ends with 1 if one fails.
"""

import json
import pathlib
import statistics
import sys

import heliograph as hg
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "integration"))
from test_denoise import furnish  # noqa: E402

FULL, SMALL = (1920, 1080), (480, 270)
GUIDES = ["beauty", "albedo_mean", "normal_mean"]
OPTIONS = {"spp": 4, "progress": False, "labels": False}
results = []


def report(name, good, text):
    results.append(bool(good))
    print(f"{name:34s} {'ok    ' if good else 'FAILED'} {text}", flush=True)


def build(client):
    scene = client.create_scene()
    furnish(scene)
    return scene


def look(scene, planes, size=FULL, seed=1, **options):
    return scene.render("cam", planes=planes, size=size, seed=seed, **(OPTIONS | options))


def by_whom(frame):
    name = json.loads(frame.manifest)["denoiser"]
    return name.endswith("on the GPU") and not frame.warnings, f"{name} {frame.warnings}"


def against_the_cpu(there, here):
    """The random numbers are the same, so what is filtered differs at few pixels."""
    for size in (SMALL, FULL):
        gpu = look(there, ["beauty", "denoised"], size)
        cpu = look(here, ["beauty", "denoised"], size)
        report(f"{size[0]}x{size[1]}: who denoised", *by_whom(gpu))
        ours, theirs = (f["denoised"][..., :3].astype("f8") for f in (gpu, cpu))
        mean = ours.mean() / theirs.mean() - 1
        off = (abs(ours - theirs) / (theirs + 0.05)).max(-1).ravel()
        middle, high, worst = np.quantile(off, [0.5, 0.999, 1])
        good = abs(mean) < 1e-3 and middle < 5e-3 and high < 0.1
        text = f"mean {mean:+.1e}; pixels off by {middle:.1e} (half), {high:.1e} (99.9 %), "
        report("  as on the CPU", good, text + f"{worst:.1e} (worst)")
        noise = abs(gpu["beauty"][..., :3] - theirs).mean() / abs(ours - theirs).mean()
        report("  noise that was taken out", noise > 10, f"{noise:.0f} times that difference")
        same = np.array_equal(gpu["denoised"][..., 3], gpu["beauty"][..., 3])
        report("  alpha", same, "beauty's")


def repeats(scene):
    first = look(scene, ["denoised"])["denoised"]
    for name, size in (("again", FULL), ("after another size", SMALL)):
        look(scene, ["denoised"], size)
        again = look(scene, ["denoised"])["denoised"]
        off = abs(again - first).max()
        report(f"repeats, {name}", off < 1e-2, f"bytes equal: {off == 0}; off by {off:.1e} at most")


def stays(scene):
    for planes in (["denoised"], ["normal_mean", "denoised", "depth", "beauty"]):
        there, here = look(scene, planes, device="cuda"), look(scene, planes)
        host = there.cpu()
        good, name = by_whom(there)
        good = good and abs(host["denoised"] - here["denoised"]).max() < 1e-2
        same = [np.array_equal(host[plane], here[plane]) for plane in planes if plane != "denoised"]
        good = good and all(same)
        report(f'device="cuda", {len(planes)} planes', good, f"as on the host: {good}; {name}")
    worlds = hg.Worlds(5)
    options = OPTIONS | {"planes": ["denoised"], "size": SMALL, "seed": 3}
    there = scene.render_worlds("cam", worlds, device="cuda", **options).cpu()
    here = scene.render_worlds("cam", worlds, **options)
    off = abs(there["denoised"] - here["denoised"]).max()
    alone = look(scene, ["denoised"], SMALL, seed=3)["denoised"]
    off = max(off, abs(here["denoised"][0, 0] - alone).max())
    report("worlds", off < 1e-2, f"of 5 off by {off:.1e} at most")


def refusals(scene):
    try:
        look(scene, ["sensor_rgb"], device="cuda")
        text = "was rendered"
    except hg.Unimplemented as error:
        text = str(error)
    report("sensors stay on the host", "made on the host" in text, text[:70])


def milliseconds(scene, planes, **options):
    times = [look(scene, planes, seed=k, **options).render_seconds for k in range(13)]
    return 1e3 * statistics.median(times[3:])


def times(scene):
    for name, options in (("to the host", {}), ('device="cuda"', {"device": "cuda"})):
        without = milliseconds(scene, GUIDES, **options)
        alone = milliseconds(scene, ["denoised"], **options)
        whole = milliseconds(scene, [*GUIDES, "denoised"], **options)
        text = f"{without:.2f} ms of 3 planes, denoised too {whole:.2f}, denoised alone {alone:.2f}"
        report(f"1080p, 4 spp, {name}", whole < without + 30, text)


def main():
    with hg.connect(arguments=["--backend", "cuda"]) as gpu, hg.connect() as cpu:
        there, here = build(gpu), build(cpu)
        against_the_cpu(there, here)
        repeats(there)
        stays(there)
        refusals(there)
        times(there)
    sys.exit(not all(results))


if __name__ == "__main__":
    main()
