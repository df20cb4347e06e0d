"""TAP-Vid: point tracks through videos, as .npz files and pickles.

Format: Doersch et al. 2022, "TAP-Vid"; github.com/google-deepmind/tapnet, tapvid/README.md.
"""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .files import batches, files, wanted_count
from .formats import Format, Task
from .report import Faults, Malformed

CHECKS = {
    "format": "files hold arrays, pickles nothing but arrays, each with points and occluded",
    "shapes": "video (T, H, W, 3) uint8, points (N, T, 2) floats, occluded (N, T) bool",
    "points": "points are finite shares of width and height: seen ones within 0 to 1",
    "seen": "each point is seen in one frame at least, each video has a point",
    "still": "a point's track has no leap of more than half the picture between frames it is "
    "seen in",
    "pickle": "a pickle has the videos of the .npz files, the same arrays",
    "counts": "as many videos as images asked for",
}
_SAFE = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.numeric", "_frombuffer"),
    ("numpy._core.numeric", "_frombuffer"),
}
_LEAP = 0.5


class _Arrays(pickle.Unpickler):
    """Loads arrays and nothing that could run."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _SAFE:
            raise pickle.UnpicklingError(f"it wants {module}.{name}, which is no array")
        return super().find_class(module, name)


def found(root: Path) -> bool:
    return any(_is_npz(path) for path in files(root, ".npz")) or any(root.glob("tapvid*.pkl"))


def _is_npz(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return {"points.npy", "occluded.npy"} <= set(archive.namelist())
    except (OSError, zipfile.BadZipFile):
        return False


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = 0
    for batch in batches(files(root, ".npz"), 4):
        count += len(batch)
        yield partial(check_files, batch)
    for path in sorted(root.glob("tapvid*.pkl")):
        yield partial(check_pickle, path, root if count else None)
    wanted = wanted_count(root)
    if wanted is not None and count and count != wanted:
        faults.add("counts", root, f"has {count} videos, and the data set {wanted} images")


def check_files(paths: list[Path], faults: Faults) -> None:
    """Some .npz files."""
    for path in paths:
        _check_video(path, "", _load(path), faults)


def _load(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, zipfile.BadZipFile, KeyError) as error:
        raise Malformed(path, f"holds no arrays that can be read ({error}): write it") from None


def check_pickle(path: Path, root: Path | None, faults: Faults) -> None:
    """A pickle; root: where the .npz files are that it is of, None when it is on its own."""
    try:
        with open(path, "rb") as file:
            videos = _Arrays(file).load()
    except (pickle.UnpicklingError, EOFError, AttributeError, ImportError) as error:
        raise Malformed(path, f"holds no arrays that can be read ({error}): write it") from None
    if isinstance(videos, list):  # as some sets of the benchmark have it
        videos = {str(i): video for i, video in enumerate(videos)}
    split = path.stem.partition("_")[2]
    if root is not None:
        own = {p.stem: p for p in files(root / split, ".npz")}
        if set(own) != set(videos):
            differs = sorted(set(own) ^ set(videos))
            faults.add("pickle", path, f"{differs[0]} is in one of it and the .npz files: in both")
            return
        for name, video in videos.items():
            arrays = _load(own[name])
            for key in ("points", "occluded", "video"):
                here, there = np.asarray(arrays.get(key)), np.asarray(video.get(key))
                if here.dtype != there.dtype or not np.array_equal(
                    here, there, equal_nan=here.dtype.kind == "f"
                ):
                    faults.add("pickle", path, f"{key} of {name} is not that of its .npz")
    else:
        for name, video in videos.items():
            _check_video(path, f"{name}: ", video, faults)


def _check_video(path: Path, name: str, arrays: dict[str, Any], faults: Faults) -> None:
    """Checks the arrays of one video. Malformed."""
    if not {"points", "occluded"} <= set(arrays):
        raise Malformed(path, f"{name}has {sorted(arrays)}: needs points and occluded")
    points, occluded, video = arrays["points"], arrays["occluded"], arrays.get("video")
    wrong = ""
    if points.ndim != 3 or points.shape[2] != 2 or points.dtype.kind != "f":
        wrong = f"points is {points.dtype} {points.shape}: needs floats (N, T, 2)"
    elif occluded.shape != points.shape[:2] or occluded.dtype != bool:
        wrong = f"occluded is {occluded.dtype} {occluded.shape}: needs bool {points.shape[:2]}"
    elif isinstance(video, np.ndarray) and (
        video.dtype != np.uint8 or video.ndim != 4 or video.shape[3] != 3
    ):
        wrong = f"video is {video.dtype} {video.shape}: needs uint8 (T, H, W, 3)"
    elif isinstance(video, np.ndarray) and len(video) != points.shape[1]:
        wrong = f"video has {len(video)} frames, tracks {points.shape[1]}: of one number"
    if wrong:
        faults.add("shapes", path, name + wrong)
        return
    seen = points[~occluded]
    if not np.isfinite(points).all() or (seen < 0).any() or (seen > 1).any():
        faults.add(
            "points",
            path,
            f"{name}points reach {np.nanmin(points):.4g} to {np.nanmax(points):.4g}: seen ones are "
            "shares of width and height, 0 to 1",
        )
        return
    hidden = int(occluded.all(axis=1).sum())
    if hidden or not len(points):
        faults.add(
            "seen", path, f"{name}{hidden} of {len(points)} points are never seen: leave them out"
        )
    both = ~occluded[:, 1:] & ~occluded[:, :-1]
    leaps = np.linalg.norm(np.diff(points, axis=1), axis=2)[both]
    if len(leaps) and leaps.max() > _LEAP:
        faults.add(
            "still",
            path,
            f"{name}a point leaps by {leaps.max():.2g} of the picture from a frame to the next: "
            "a track is of one point, (N, T) and not (T, N)",
        )


FORMAT = Format("tapvid", "TAP-Vid", "*.npz with points, or tapvid*.pkl", CHECKS, found, tasks)
