"""Facts that a reader found in a model, as numbers that another reader's can be compared with. Used
by the readers of bench/models.py; needs numpy alone, so that it runs in anybody's Python.

A reader is a program: it takes one path of a file per line on stdin, and answers each with a line
of JSON on stdout: the facts, or {"refusal": why}.
"""

import json
import os
import sys

import numpy as np

Y_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # to +Z up


class Surface:
    """Collects triangles in the world, metres, +Z up."""

    def __init__(self):
        self.triangles, self.area = 0, 0.0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, positions, indices, world=None):
        """positions: (V, 3); indices: (F, 3); world: (4, 4), world_from_mesh."""
        corners = np.asarray(positions, np.float64)[np.asarray(indices, np.int64)]
        if world is not None:
            corners = corners @ world[:3, :3].T + world[:3, 3]
        if len(corners) == 0:
            return
        sides = corners[:, 1:] - corners[:, :1]
        self.triangles += len(corners)
        self.area += float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)
        self.low = np.minimum(self.low, corners.min((0, 1)))
        self.high = np.maximum(self.high, corners.max((0, 1)))

    def facts(self):
        bounds = [self.low.tolist(), self.high.tolist()] if self.triangles else None
        return {"triangles": self.triangles, "area": self.area, "bounds": bounds}


def mean_colour(texels):
    """[red, green, blue] of (H, W) or (H, W, C) texels of any dtype, as they are stored, 0 to 1."""
    texels = np.asarray(texels)
    scale = np.iinfo(texels.dtype).max if texels.dtype.kind == "u" else 1
    planes = texels.reshape(*texels.shape[:2], -1).astype(np.float64) / scale
    means = planes.mean((0, 1))
    return [round(float(v), 4) for v in (means[:3] if len(means) > 2 else [means[0]] * 3)]


def serve(read):
    """Answers paths with the facts of `read`. Output of libraries goes to stderr."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        try:
            facts = read(line.rstrip("\n"))
        except Exception as error:  # whatever a library raises is its refusal
            facts = {"refusal": f"{type(error).__name__}: {error}"[:400]}
        print(json.dumps(facts), file=answers, flush=True)
