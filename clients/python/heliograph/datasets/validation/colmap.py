"""COLMAP: sparse models as text. Lenses are in colmap_lens.py.

Format: https://colmap.github.io/format.html, "Text Format"; the upper left pixel's centre is
(0.5, 0.5).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .colmap_lens import COUNTS, seen_at
from .files import batches, check_size, files, wanted_count
from .formats import Format, Task
from .geometry import is_unit, rotation_of
from .report import Faults, Malformed

CHECKS = {
    "format": "cameras.txt, images.txt (two lines per image) and points3D.txt have their fields",
    "ids": "ids of cameras, images and points are there once and start at 1, names once",
    "references": "images name cameras and points that are there",
    "cameras": "models are COLMAP's with as many parameters, focal lengths and sizes positive",
    "quaternions": "QW QX QY QZ has length 1",
    "image_files": "each image's picture is there and has its camera's size",
    "tracks": "the tracks of points3D.txt are the observations of images.txt",
    "behind": "observed points are before the camera",
    "reprojection": "observations are where their points project to, within 1 px",
    "counts": "as many images as asked for",
}


@dataclass(frozen=True)
class Camera:
    model: str
    size: tuple[int, int]
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class Image:
    """observed: (N, 2) px; points: (N,) ids, -1 without one."""

    number: int
    pose: tuple[float, ...]
    camera: int
    name: str
    observed: NdArray
    points: NdArray


def found(root: Path) -> bool:
    return next(_models(root), None) is not None


def _models(root: Path) -> Iterator[Path]:
    for path in files(root, ".txt"):
        if path.name == "cameras.txt" and (path.parent / "images.txt").is_file():
            yield path.parent


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = 0
    for folder in _models(root):
        cameras = _read_cameras(folder / "cameras.txt", faults)
        ids, places, tracks = _read_points(folder / "points3D.txt", faults)
        numbers: Counter[int] = Counter()
        names: Counter[str] = Counter()
        for batch in batches(_read_images(folder / "images.txt"), 16):
            count += len(batch)
            numbers.update(image.number for image in batch)
            names.update(image.name for image in batch)
            needed = []
            for image in batch:
                wanted = image.points[image.points >= 0]
                rows = np.searchsorted(ids, wanted)
                rows = rows[rows < len(ids)]
                own = tracks[tracks[:, 0] == image.number]
                needed.append((ids[rows], places[rows], own[:, 1:]))
            yield partial(check_images, root, folder / "images.txt", batch, needed, cameras)
        _check_ids(folder / "images.txt", "image", numbers, faults)
        for name in [name for name, times in names.items() if times > 1]:
            faults.add("ids", folder / "images.txt", f"{name} is there {names[name]} times")
        stray = set(tracks[:, 0].tolist()) - set(numbers)
        if stray:
            faults.add("tracks", folder / "points3D.txt", f"names image {min(stray)}, of no entry")
    wanted_images = wanted_count(root)
    if wanted_images is not None and count != wanted_images:
        faults.add("counts", root, f"has {count} images, and the data set {wanted_images}")


def _check_ids(path: Path, what: str, ids: Counter[int], faults: Faults) -> None:
    for number, times in sorted(ids.items()):
        if times > 1 or number < 1:
            why = f"is there {times} times" if times > 1 else "is below 1"
            faults.add("ids", path, f"{what} {number} {why}: count them from 1")


def _lines(path: Path) -> Iterator[str]:
    """Lines of a file, without comments. Malformed where it is not there."""
    if not path.is_file():
        raise Malformed(path, "is not there, and a model has it: write it, if need be empty")
    with open(path) as file:
        for line in file:
            if not line.startswith("#"):
                yield line.rstrip("\n")


def _read_cameras(path: Path, faults: Faults) -> dict[int, Camera]:
    cameras: dict[int, Camera] = {}
    ids: Counter[int] = Counter()
    for line in filter(str.strip, _lines(path)):
        words = line.split()
        number, model = int(words[0]), words[1]
        camera = Camera(model, (int(words[2]), int(words[3])), tuple(map(float, words[4:])))
        ids[number] += 1
        if model not in COUNTS or len(camera.parameters) != COUNTS[model]:
            faults.add(
                "cameras",
                path,
                f"camera {number}: {model} with {len(camera.parameters)} parameters: COLMAP has "
                + ", ".join(f"{name} {count}" for name, count in COUNTS.items()),
            )
        elif min(camera.size) <= 0 or camera.parameters[0] <= 0:
            faults.add("cameras", path, f"camera {number}: sizes and focal lengths are positive")
        cameras[number] = camera
    _check_ids(path, "camera", ids, faults)
    return cameras


def _read_points(path: Path, faults: Faults) -> tuple[NdArray, NdArray, NdArray]:
    """Sorted ids (P,), places (P, 3), and tracks (T, 3): image, row in it, point."""
    ids: list[int] = []
    places: list[list[float]] = []
    tracks: list[tuple[int, int, int]] = []
    for line in filter(str.strip, _lines(path)):
        words = line.split()
        if len(words) < 8 or len(words) % 2:
            raise Malformed(path, f"{line[:50]!r}...: needs ID X Y Z R G B ERROR and pairs")
        ids.append(int(words[0]))
        places.append([float(word) for word in words[1:4]])
        pairs = list(map(int, words[8:]))
        tracks += [(image, row, ids[-1]) for image, row in zip(pairs[::2], pairs[1::2])]
    _check_ids(path, "point", Counter(ids), faults)
    order = np.argsort(ids, kind="stable")
    table = np.array(tracks, np.int64).reshape(-1, 3)
    return np.array(ids, np.int64)[order], np.reshape(places, (-1, 3))[order], table


def _read_images(path: Path) -> Iterator[Image]:
    lines = iter(_lines(path))
    for line in lines:
        if not line.strip():
            continue
        words = line.split()
        if len(words) < 10:
            raise Malformed(
                path,
                f"{line[:60]!r}: needs ID QW QX QY QZ TX TY TZ CAMERA NAME, then a line of points, "
                "an empty one without any",
            )
        try:
            pose = tuple(float(word) for word in words[1:8])
            row = np.array(next(lines, "").split(), float).reshape(-1, 3)
            number, camera = int(words[0]), int(words[8])
        except ValueError as error:
            raise Malformed(path, f"image {words[0]}: {error}; each has two lines") from None
        yield Image(
            number, pose, camera, " ".join(words[9:]), row[:, :2], row[:, 2].astype(np.int64)
        )


def check_images(
    root: Path,
    path: Path,
    images: list[Image],
    needed: list[tuple[NdArray, NdArray, NdArray]],
    cameras: dict[int, Camera],
    faults: Faults,
) -> None:
    """Some images. needed: of each the ids and places of its points, and (row, point) of tracks."""
    for image, (ids, places, own) in zip(images, needed):
        name = f"image {image.number} ({image.name})"
        camera = cameras.get(image.camera)
        if camera is None:
            faults.add("references", path, f"{name} names camera {image.camera}: it is not there")
            continue
        where = [root / "images" / image.name, root / image.name]
        picture = next((one for one in where if one.is_file()), where[0])
        check_size(faults, "image_files", picture, camera.size, path.name)
        if not is_unit(image.pose[:4]):
            length = np.linalg.norm(image.pose[:4])
            faults.add("quaternions", path, f"{name}: length {length:.4g}: needs 1, QW first")
            continue
        rows = np.flatnonzero(image.points >= 0)
        known = np.isin(image.points[rows], ids)
        if not known.all():
            missing = image.points[rows][~known][0]
            faults.add("references", path, f"{name} names point {missing}: points3D.txt has it not")
            continue
        seen = {(int(row), int(image.points[row])) for row in rows}
        named = {(int(row), int(point)) for row, point in own}
        if seen != named:
            differs = sorted(seen ^ named)[0]
            faults.add(
                "tracks",
                path,
                f"{name}: row {differs[0]} and point {differs[1]} belong to each other in one of "
                "images.txt and points3D.txt only",
            )
        if camera.model in COUNTS and len(camera.parameters) == COUNTS[camera.model] and len(rows):
            at = places[np.searchsorted(ids, image.points[rows])] if _sorted(ids) else places
            _check_observed(path, name, (image, rows, at, camera), faults)


def _sorted(ids: NdArray) -> bool:
    return bool((np.diff(ids) > 0).all())


def _check_observed(path: Path, name: str, what: Any, faults: Faults) -> None:
    """what: the image, the rows of its observed points, their places (N, 3), its camera."""
    image, rows, places, camera = what
    rotation = rotation_of(image.pose[:4], "wxyz")
    points = places @ rotation.T + np.array(image.pose[4:])
    if (points[:, 2] <= 0).any():
        faults.add(
            "behind",
            path,
            f"{name}: {int((points[:, 2] <= 0).sum())} of its points are behind the camera: poses "
            "are world to camera, OpenCV camera",
        )
        return
    error = np.linalg.norm(seen_at(camera, points) - image.observed[rows], axis=1)
    if error.max() > 1:
        faults.add(
            "reprojection",
            path,
            f"{name}: an observation is {error.max():.1f} px from its point's projection (median "
            f"{np.median(error):.2g}): poses are world to camera, pixel centres at .5",
        )


FORMAT = Format("colmap", "COLMAP", "cameras.txt beside images.txt", CHECKS, found, tasks)
