"""The scene on which writers of data sets are tested, and what reads their files.

The camera has fx != fy, its principal point off the centre, and the picture is not square. One
object is partly outside, one behind another, one wholly hidden.
"""

import json
from pathlib import Path

import cv2
import heliograph as hg
import heliograph.datasets as hd
import numpy as np

W, H = 96, 64
K = np.array([[88.0, 0, 43.7], [0, 101.0, 35.2], [0, 0, 1]])
LENS = hg.Camera.from_intrinsics(K, W, H)
EYE, AT = (0.2, -2.4, 0.9), (0.0, 0, 0.25)


def stage(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        half = np.diag([-1.0, -1, 1, 1])
        mesh = edit.mesh("box", **hg.shapes.cube(0.4), symmetries=[half])
        round_ = {"axis": (0, 0, 1)}
        ball = edit.mesh("round", **hg.shapes.sphere(0.18), symmetries=[round_])
        turn = hg.Pose((-0.3, 0.1, 0.2), euler=(0, 0, 0.5))
        edit.entity("crate", mesh=mesh, category="crate", label=1, transform=turn)
        lid = hg.Pose((0.05, 0, 0.25), scale=(1, 0.5, 0.2))
        edit.entity("crate/lid", parent="crate", mesh=mesh, transform=lid)
        edit.entity(
            "behind", mesh=ball, category="ball", label=2, transform=hg.Pose((-0.1, 0.7, 0.2))
        )
        edge = hg.Pose((1.2, 0.1, 0.2), euler=(0.2, 0.1, 0.3))
        edit.entity("edge", mesh=mesh, category="block", label=3, transform=edge)
        hidden = hg.Pose((-0.45, 0.75, 0.13), scale=0.3)
        edit.entity("hidden", mesh=mesh, category="block", label=4, transform=hidden)
        edit.entity("nameless", mesh=ball, label=5, transform=hg.Pose((0.45, -0.4, 0.18)))
        edit.entity("off", visible=False)
        edit.entity("off/box", parent="off", mesh=mesh, label=0, transform=hg.Pose((0, -1, 0.5)))
        edit.entity("cam", camera=LENS, transform=hg.look_at(EYE, AT))


def shift(draw):
    """Another view, another place of the ball."""
    x = draw.rng.uniform(-0.1, 0.1)
    draw.place(["cam"], [hg.look_at((EYE[0] + x, EYE[1], EYE[2]), AT)])
    draw.place(["behind"], [hg.Pose((x - 0.1, 0.7, 0.2))])


def view(draw):
    """Another view alone."""
    x = draw.rng.uniform(-0.5, 0.5)
    draw.place(["cam"], [hg.look_at((EYE[0] + x, EYE[1], EYE[2]), AT)])


def made(scene, writer, randomizer=shift, **options):
    """The frames that the writer got, by index."""
    frames = {}
    write = writer.write

    def kept(image):
        frames[image.index] = image.frame
        return write(image)

    writer.write = kept
    done = hd.generate(scene, "cam", randomizer, **{"count": 2, "spp": 1, **options}, writer=writer)
    del writer.write
    assert done.complete
    return dict(sorted(frames.items()))  # threads write them in any order


def load(path):
    return json.loads(Path(path).read_text())


def picture(path):
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found
