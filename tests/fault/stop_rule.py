"""The noise that a picture reports when it stops by `noise=` is the error that it has, where light
is rare: on eleven scenes within a factor of 1.5, whether too large or too small.

The error is docs/python.md's: the mean over the pixels of the standard error of a pixel's
luminance over that luminance, over at least a hundredth of the picture's mean. It is that of
PICTURES pictures of as many samples, each of a seed of its own; all of them together are the
reference. HELIOGRAPH_BACKEND=cuda tries a GPU. A scene's name as an argument runs that one alone.
"""

import os
import sys

import common
import numpy as np
import rare_light

LEVELS = common.size((0.4, 0.2, 0.1), (0.4,))
MOST_SAMPLES = common.size(1024, 64)
STOPS = 4  # pictures that stop by themselves
PICTURES = common.size(24, 12)
QUICK = ("small_hole", "lamp_in_fog", "blinds")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], "f4")


def luminance(frame):
    return frame["beauty"][..., :3] @ LUMINANCE


def stops(scene, level):
    """Samples and reported noise of pictures that end at a level of noise, or at MOST_SAMPLES."""
    options = {"noise": level, "spp": MOST_SAMPLES, "planes": ["beauty"], "labels": False}
    frames = [scene.render("cam", seed=seed, **options) for seed in range(STOPS)]
    return [(frame.samples, float(frame.noise)) for frame in frames]


def pictures(scene, samples):
    options = {"spp": samples, "planes": ["beauty"], "labels": False}
    seeds = range(1000 * samples, 1000 * samples + PICTURES)
    return np.stack([luminance(scene.render("cam", seed=seed, **options)) for seed in seeds])


def relative(deviation, reference):
    """The mean over the pixels of what deviates over what is there."""
    return float((deviation / np.maximum(reference, 0.01 * reference.mean())).mean())


def measure(scene):
    """(level, samples, reported, true) of each picture that stopped, and the reference's error."""
    stopped = {level: stops(scene, level) for level in LEVELS}
    counts = {level: int(np.median([n for n, _ in of])) for level, of in stopped.items()}
    taken = {samples: pictures(scene, samples) for samples in set(counts.values())}
    most = max(taken)
    total = sum(taken)
    reference = sum(of.mean(0) * (samples / total) for samples, of in taken.items())
    true = {n: relative(of.std(0, ddof=1), reference) for n, of in taken.items()}
    rows = []
    for level, of in stopped.items():
        n = counts[level]
        rows += [(level, m, noise, true[n] * np.sqrt(n / m)) for m, noise in of]
    return rows, true[most] / np.sqrt(PICTURES * total / most)


def factor(reported, true):
    """How far two differ, at least 1; 0 is as far from any other number as can be."""
    if reported == true:
        return 1.0
    return max(reported, true) / min(reported, true) if min(reported, true) > 0 else np.inf


def judge(report, name, rows):
    for level in LEVELS:
        of = [row for row in rows if row[0] == level]
        samples = "/".join(str(row[1]) for row in of)
        reported, true = (np.mean([row[i] for row in of]) for i in (2, 3))
        print(f"  {name} at {level}: {samples} samples, reported {reported:.3g}, true {true:.3g}")
    worst = max(rows, key=lambda row: factor(*row[2:]))
    label = f"{name}: reported {worst[2]:.3g}, true {worst[3]:.3g}, factor"
    report.figure(label, factor(*worst[2:]), 1.5, slack=False)


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    asked = [name for name in sys.argv[1:] if name in rare_light.SCENES]
    names = asked or common.size(tuple(rare_light.SCENES), QUICK)
    with common.Report("stopping by noise") as report, common.daemon(*flags) as client:
        for name in names:
            with client.create_scene() as scene:
                with scene.edit() as edit:
                    rare_light.SCENES[name](edit)
                rows, error = measure(scene)
            print(f"  {name}: error of the reference {error:.2g}")
            judge(report, name, rows)


if __name__ == "__main__":
    main()
