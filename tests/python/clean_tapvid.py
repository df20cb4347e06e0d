"""A clean TAP-Vid data set by numpy and pickle, and faults to plant in it."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np

FRAMES, POINTS = 4, 5


def video(index: int) -> dict[str, np.ndarray]:
    steps = np.arange(FRAMES)[None, :, None]
    start = np.stack([np.linspace(0.1, 0.6, POINTS), np.linspace(0.2, 0.9, POINTS)], axis=1)
    points = start[:, None] + steps * np.array([0.1, -0.05])
    occluded = np.zeros((POINTS, FRAMES), bool)
    occluded[1, 2] = True
    pixels = np.full((FRAMES, 6, 8, 3), 10 * index, np.uint8)
    return {"video": pixels, "points": points.astype(np.float32), "occluded": occluded}


def make(root: Path) -> None:
    root.mkdir(parents=True, exist_ok=True)
    for i in range(2):
        np.savez_compressed(root / f"{i:06d}.npz", **video(i))
    pickled(root)


def pickled(root: Path) -> None:
    videos = {}
    for path in sorted(root.glob("*.npz")):
        with np.load(path) as arrays:
            videos[path.stem] = dict(arrays)
    (root / "tapvid.pkl").write_bytes(pickle.dumps(videos, protocol=4))


def arrays(change, repickle: bool = True):
    def plant(root: Path) -> None:
        content = video(0)
        change(content)
        np.savez_compressed(root / "000000.npz", **content)
        if repickle:
            pickled(root)

    return plant


class Runs:
    def __reduce__(self):
        return os.getcwd, ()


FAULTS = {
    "no archive": ("tapvid.format", lambda root: (root / "000001.npz").write_bytes(b"PK")),
    "pickle that runs something": (
        "tapvid.format",
        lambda root: (root / "tapvid.pkl").write_bytes(pickle.dumps({"000000": Runs()})),
    ),
    "video of floats": (
        "tapvid.shapes",
        arrays(lambda a: a.update(video=a["video"] / np.float32(255))),
    ),
    "occluded as visible counts": (
        "tapvid.shapes",
        arrays(lambda a: a.update(occluded=a["occluded"].astype(np.uint8))),
    ),
    "points by frames": (
        "tapvid.shapes",
        arrays(lambda a: a.update(points=a["points"].transpose(1, 0, 2))),
    ),
    "points in pixels": (
        "tapvid.points",
        arrays(lambda a: a.update(points=a["points"] * np.float32(8))),
    ),
    "nan behind the camera": (
        "tapvid.points",
        arrays(lambda a: a["points"].__setitem__((1, 2), np.nan)),
    ),
    "point never seen": ("tapvid.seen", arrays(lambda a: a["occluded"].__setitem__(3, True))),
    "tracks of different points": (
        "tapvid.still",
        arrays(lambda a: a["points"].__setitem__((0, 1), (0.95, 0.9))),
    ),
    "pickle of before": (
        "tapvid.pickle",
        arrays(lambda a: a["points"].__setitem__((0, 0), 0.15), repickle=False),
    ),
    "video missing in the pickle": (
        "tapvid.pickle",
        lambda root: (root / "tapvid.pkl").write_bytes(pickle.dumps({"000000": video(0)})),
    ),
    "video missing": (
        "tapvid.counts",
        lambda root: [
            (root / ".heliograph").mkdir(),
            (root / ".heliograph/dataset.json").write_text('{"count": 3}'),
        ],
    ),
}
