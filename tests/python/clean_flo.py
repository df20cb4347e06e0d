"""A clean Middlebury data set by struct and numpy, and faults to plant in it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from shapes_seen import HEIGHT, WIDTH, picture

FLOW = "other-gt-flow/000000/flow10.flo"


def encoded(flow: np.ndarray, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    header = struct.pack("<fii", 202021.25, width, height)
    return header + flow.astype("<f4").tobytes()


def flow() -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    out = np.stack([columns / 10, -rows / 5], axis=-1)
    out[:3, :3] = 1e10
    return out


def make(root: Path) -> None:
    for i in range(2):
        for name in ("frame10", "frame11"):
            picture(root / f"other-data/{i:06d}/{name}.png", i)
        path = root / f"other-gt-flow/{i:06d}/flow10.flo"
        path.parent.mkdir(parents=True)
        path.write_bytes(encoded(flow()))


def written(change):
    return lambda root: (root / FLOW).write_bytes(change())


def half_unknown() -> bytes:
    out = flow()
    out[5, 5, 0] = 1e10
    return encoded(out)


FAULTS = {
    "picture is none": (
        "flo.format",
        lambda root: (root / "other-data/000000/frame10.png").write_text("P3"),
    ),
    "magic big-endian": (
        "flo.magic",
        written(lambda: encoded(flow())[3::-1] + encoded(flow())[4:]),
    ),
    "height before width": ("flo.size", written(lambda: encoded(flow(), HEIGHT, WIDTH))),
    "row missing": ("flo.size", written(lambda: encoded(flow()[1:]))),
    "half unknown": ("flo.unknown", written(half_unknown)),
    "NaN": ("flo.unknown", written(lambda: encoded(np.where(flow() > 1e9, np.nan, flow())))),
    "flow times 1000": ("flo.range", written(lambda: encoded(flow() * 1000))),
    "second picture removed": (
        "flo.pictures",
        lambda root: (root / "other-data/000001/frame11.png").unlink(),
    ),
    "second picture of another size": (
        "flo.pictures",
        lambda root: picture(root / "other-data/000001/frame11.png", 1, (9, 9)),
    ),
    "flow removed": (
        "flo.counts",
        lambda root: [(root / FLOW).unlink(), (root / FLOW).parent.rmdir()],
    ),
}
