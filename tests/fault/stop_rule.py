"""The noise that a picture reports when it stops by `noise=` is the error that it has, where light
is rare: on eleven scenes within a factor of 1.5, too large or too small.

The error is docs/python.md's: the mean over the pixels of the standard error of a pixel's
luminance over that luminance, over at least a hundredth of the picture's mean. Luminance and the
variance of a sample are those of a reference of so many samples that it knows both: of its own
error a quarter at most is that of pixels of fewer than eight samples. Reported is the mean
of PICTURES pictures, each of a seed of its own. HELIOGRAPH_BACKEND=cuda tries a GPU. A scene's name
as an argument runs that one alone.
"""

import os
import sys

import common
import numpy as np
import rare_light

LEVELS = common.size((0.4, 0.2, 0.1), (0.4,))
MOST_SAMPLES = common.size(2048, 256)
REFERENCE = common.size(131072, 4096)
RAREST = {"rough_plates": 8}  # want a reference of so many times as many samples
PICTURES = 4
QUICK = ("small_hole", "lamp_in_fog", "blinds")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], "f4")


def luminance(frame):
    return frame["beauty"][..., :3] @ LUMINANCE


def stops(scene, level):
    """(level, samples, reported noise) of pictures that end at it, or at MOST_SAMPLES."""
    options = {"noise": level, "spp": MOST_SAMPLES, "planes": ["beauty"], "labels": False}
    frames = [scene.render("cam", seed=seed, **options) for seed in range(PICTURES)]
    return [(level, frame.samples, float(frame.noise)) for frame in frames]


class Reference:
    def __init__(self, scene, samples):
        self.samples = samples
        planes = ["beauty", "variance"]
        frame = scene.render("cam", seed=1000, spp=samples, planes=planes, labels=False)
        light = luminance(frame).astype("f8")
        variance = frame["variance"].reshape(light.shape).astype("f8")
        relative = np.sqrt(variance) / np.maximum(light, 0.01 * light.mean())
        self.error = relative.mean()
        hits = light**2 / np.maximum(variance + light**2 / samples, 1e-300)
        self.unknown = relative[hits < 8].sum() / relative.sum()

    def error_of(self, samples):
        """The error of a picture of so many samples."""
        return self.error * np.sqrt(self.samples / samples)


def factor(reported, true):
    """How far two differ, at least 1; 0 is as far from any other number as can be."""
    if reported == true:
        return 1.0
    return max(reported, true) / min(reported, true) if min(reported, true) > 0 else np.inf


def judge(report, name, rows):
    """rows: (level, samples, reported, true)."""
    for level in LEVELS:
        of = [row for row in rows if row[0] == level]
        samples = "/".join(str(row[1]) for row in of)
        reported, true = (np.mean([row[i] for row in of]) for i in (2, 3))
        print(f"  {name} at {level}: {samples} samples, reported {reported:.3g}, true {true:.3g}")
        label = f"{name} at {level}: reported {reported:.3g}, true {true:.3g}, factor"
        report.figure(label, factor(reported, true), 1.5, slack=False)


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    asked = [name for name in sys.argv[1:] if name in rare_light.SCENES]
    names = asked or common.size(tuple(rare_light.SCENES), QUICK)
    with common.Report("stopping by noise") as report, common.daemon(*flags) as client:
        for name in names:
            with client.create_scene() as scene:
                with scene.edit() as edit:
                    rare_light.SCENES[name](edit)
                reference = Reference(scene, REFERENCE * RAREST.get(name, 1))
                stopped = [row for level in LEVELS for row in stops(scene, level)]
            report.figure(f"{name}: unknown of the reference", reference.unknown, 0.25, slack=False)
            judge(report, name, [(*row, reference.error_of(row[1])) for row in stopped])


if __name__ == "__main__":
    main()
