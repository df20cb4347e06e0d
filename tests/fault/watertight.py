"""No ray leaves a closed mesh between its triangles: a billion rays of labels and half as many of a
picture, from about the middle of boxes of 12 to 49,152 triangles.

HELIOGRAPH_BACKEND=cuda tries a GPU.
"""

import os
import pathlib
import sys

import common
import heliograph as hg
import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "integration"))
from test_watertight import crumpled_box

SQUARES = (1, 4, 16, 64)  # along a side
WIDTH = 4096 if not common.SHORT else 512
SAMPLED = WIDTH // 4


def furnish(scene, number):
    rng = np.random.default_rng(number)
    at = rng.normal(size=3)
    with scene.edit() as edit:
        box = edit.mesh("box", **crumpled_box(SQUARES[number % len(SQUARES)], rng))
        black = edit.material("black", base_color=0, specular=0)
        edit.entity("box", mesh=box, material=black, transform=hg.Pose(at))
        edit.dome(color=1e4)
        lens = hg.Camera.from_fov(100, WIDTH, WIDTH, degrees=True)
        eye = hg.look_at(at + 0.05 * rng.normal(size=3), at + rng.normal(size=3))
        edit.entity("cam", camera=lens, transform=eye)


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    pictures = common.size(61, 4)
    labels = out = seen = lit = 0
    with common.Report("rays in closed meshes") as report, common.daemon(*flags) as client:
        with client.create_scene() as scene:
            for number in range(pictures):
                furnish(scene, number)
                depth = scene.render("cam", planes=["depth"], labels=False)["depth"]
                labels, out = labels + depth.size, out + int(np.isinf(depth).sum())
                if number % 8:
                    continue
                size = (SAMPLED, SAMPLED)
                frame = scene.render("cam", planes=["beauty"], spp=64, size=size, labels=False)
                seen += 64 * SAMPLED**2
                lit += int((frame["beauty"][..., :3] > 0).any(-1).sum())
        report.figure(f"of {labels:.3g} rays of labels leave", out, 0, slack=False)
        report.figure(f"pixels of {seen:.3g} camera rays see the sky", lit, 0, slack=False)


if __name__ == "__main__":
    main()
