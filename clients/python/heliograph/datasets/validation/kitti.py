"""KITTI: objects (label_2, calib). Flow and disparity are in kitti_flow.py.

Format: devkit_object/readme.txt, devkit_scene_flow/devkit/readme.txt (cvlibs.net/datasets/kitti).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from ..._wire.arrays import NdArray
from .files import batches, picture_size, wanted_count
from .formats import Format, Task
from .geometry import project, rotation_fault, wrapped
from .kitti_flow import FOLDERS, check_maps
from .report import Faults, Malformed

CHECKS = {
    "format": "labels have 15 fields with numbers, calibrations their matrices, PNGs can be read",
    "names": "files are called 000123.txt and .png, flow and disparity 000123_10.png",
    "counts": "each label has a picture and a calibration, each picture a label, ImageSets name "
    "existing images",
    "calib": "P0 to P3 project (positive focal lengths), R0_rect and Tr_velo_to_cam rotate",
    "truncation": "truncated is within 0 to 1",
    "occlusion": "occluded is 0, 1, 2 or 3",
    "bbox": "left < right, top < bottom, within the picture, 0-based",
    "size": "height, width, length are positive",
    "alpha": "is rotation_y - atan2(x, z), both within -pi to pi",
    "behind": "z is positive",
    "dont_care": "DontCare regions have a box, and otherwise KITTI's -1, -10 and -1000 alone",
    "units": "sizes and places are both in metres: the box's projection and bbox are alike in size",
    "reprojection": "the 3D box, its bottom face's centre at x, y, z, spans the 2D box by P2",
    "map_files": "flow and disparity have their picture's size, flow's second picture is there",
    "flow_valid": "flow is 16-bit RGB: u, v, and a third channel of 0 and 1",
    "flow_range": "flow is 64 u + 32768: no more than the picture's size as a rule, not saturated",
    "flow_noc": "flow_noc is flow_occ where both pictures see the point",
    "disparity": "disparity is 16-bit grey, 256 d, not saturated, no more than the picture's width",
    "disparity_noc": "disp_noc is disp_occ where both pictures see the point",
}

_MATRICES = {
    **{f"P{i}": (3, 4) for i in range(4)},
    "R0_rect": (3, 3),
    "Tr_velo_to_cam": (3, 4),
}
_REGION = [-1.0, -1, -10, -1, -1, -1, -1000, -1000, -1000, -10]  # all but the box


def found(root: Path) -> bool:
    return any(
        (root / "training" / folder).is_dir() for folder in ("label_2", "flow_occ", "disp_occ_0")
    )


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    base = root / "training"
    labels = _listed(base / "label_2", ".txt", 6, faults)
    if (base / "label_2").is_dir():
        _check_counts(root, labels, faults)
        for batch in batches(labels, 32):
            yield partial(check_labels, base, batch)
    for folder in FOLDERS:
        names = _listed(base / folder, ".png", 9, faults)
        for batch in batches(names, 4):
            yield partial(check_maps, base, folder, batch)
    wanted = wanted_count(root)
    if wanted is not None and labels and len(labels) != wanted:
        faults.add(
            "counts", base / "label_2", f"has {len(labels)} files, the data set {wanted} images"
        )


def _listed(folder: Path, ending: str, length: int, faults: Faults) -> list[str]:
    """The stems in a folder that are as they should be."""
    good = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        stem = path.stem
        if path.suffix != ending or len(stem) != length or not stem.replace("_10", "").isdigit():
            example = "000123" + ("_10" if length == 9 else "") + ending
            faults.add("names", path, f"is no name of KITTI's: needs one like {example}")
        else:
            good.append(stem)
    return good


def _check_counts(root: Path, labels: list[str], faults: Faults) -> None:
    base = root / "training"
    for folder, ending in (("image_2", ".png"), ("calib", ".txt")):
        own = base / folder
        there = {path.stem for path in own.iterdir()} if own.is_dir() else set()
        for stem in labels:
            if stem not in there:
                faults.add(
                    "counts",
                    own / f"{stem}{ending}",
                    "is not there, and label_2 has its label: write it",
                )
        if folder == "image_2":
            for stem in sorted(s for s in there if len(s) == 6 and s not in set(labels)):
                faults.add(
                    "counts",
                    own / f"{stem}{ending}",
                    "has no label: a picture without objects has an empty file in label_2",
                )
    sets = root / "ImageSets"
    for path in sorted(sets.iterdir()) if sets.is_dir() else ():
        missing = sorted(set(path.read_text().split()) - set(labels))
        if missing:
            faults.add("counts", path, f"names {missing[0]}, and label_2 has no such file")


def check_labels(base: Path, stems: list[str], faults: Faults) -> None:
    """Some files of label_2 with their calibrations."""
    for stem in stems:
        picture, calib = base / f"image_2/{stem}.png", base / f"calib/{stem}.txt"
        size = picture_size(picture) if picture.is_file() else None
        P2 = _calibration(calib, faults) if calib.is_file() else None
        path = base / f"label_2/{stem}.txt"
        for number, line in enumerate(path.read_text().splitlines(), 1):
            words = line.split()
            if len(words) != 15:
                faults.add(
                    "format",
                    path,
                    f"line {number} has {len(words)} fields: needs 15, the type first",
                )
                continue
            _Object(path, number, words, faults).check(size, P2)


def _calibration(path: Path, faults: Faults) -> NdArray | None:
    """P2, (3, 4)."""
    rows = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    matrices = {}
    for name, shape in _MATRICES.items():
        try:
            matrices[name] = np.array(rows[name].split(), float).reshape(shape)
        except (KeyError, ValueError):
            count = shape[0] * shape[1]
            faults.add("format", path, f"{name} needs {count} numbers, by rows")
            return None
    for name, matrix in matrices.items():
        if name[0] == "P":
            wrong = "" if matrix[0, 0] > 0 and matrix[1, 1] > 0 and matrix[2, 2] == 1 else (
                f"is {matrix.tolist()}: needs fx, 0, cx, 0, fy, cy, 0, 0, 1 in its left part"
            )  # fmt: skip
        else:
            wrong = rotation_fault(matrix[:, :3])
        if wrong:
            faults.add("calib", path, f"{name} {wrong}")
            return None
    return matrices["P2"]


class _Object:
    """A line of label_2."""

    def __init__(self, path: Path, number: int, words: list[str], faults: Faults) -> None:
        self.path, self.name, self.faults = path, f"line {number} ({words[0]})", faults
        self.is_region = words[0] == "DontCare"
        try:
            values = [float(word) for word in words[1:]]
        except ValueError:
            raise Malformed(path, f"line {number}: fields 2 to 15 are numbers") from None
        if not all(map(math.isfinite, values)):
            raise Malformed(path, f"line {number}: its numbers are finite")
        self.values = values
        self.truncated, self.occluded, self.alpha = values[:3]
        self.box = np.array(values[3:7])
        self.height, self.width, self.length = values[7:10]
        self.place, self.turn = np.array(values[10:13]), values[13]

    def fault(self, check: str, message: str) -> None:
        self.faults.add(check, self.path, f"{self.name}: {message}")

    def check(self, size: tuple[int, int] | None, P2: NdArray | None) -> None:
        if self.is_region:
            self._box(size)
            self._region()
        else:
            self._labelled(size, P2)

    def _region(self) -> None:
        others = [*self.values[:3], *self.values[7:]]
        if others != _REGION:
            self.fault("dont_care", f"has {others} beside its box: needs {_REGION}, no object")

    def _labelled(self, size: tuple[int, int] | None, P2: NdArray | None) -> None:
        if not 0 <= self.truncated <= 1:
            self.fault("truncation", f"truncated is {self.truncated:g}: needs 0 to 1")
        if self.occluded not in (0, 1, 2, 3):
            self.fault("occlusion", f"occluded is {self.occluded:g}: needs 0, 1, 2 or 3")
        good = self._box(size)
        if min(self.height, self.width, self.length) <= 0:
            self.fault("size", f"{self.height:g} {self.width:g} {self.length:g}: needs metres > 0")
            good = False
        if self.place[2] <= 0:
            self.fault(
                "behind", f"z is {self.place[2]:g}: it is before the camera, which looks at +z"
            )
            return
        self._alpha()
        if good and size and P2 is not None:
            self._reprojection(size, P2)

    def _box(self, size: tuple[int, int] | None) -> bool:
        left, top, right, bottom = self.box
        inside = size is None or (right <= size[0] and bottom <= size[1])
        if left > right or top > bottom or left < 0 or top < 0 or not inside:
            self.fault(
                "bbox",
                f"bbox is {self.box.tolist()}: needs left, top, right, bottom within the picture "
                f"{size}, from 0",
            )
            return False
        return True

    def _alpha(self) -> None:
        expected = wrapped(self.turn - math.atan2(self.place[0], self.place[2]))
        if max(abs(self.alpha), abs(self.turn)) > math.pi + 0.01:
            self.fault(
                "alpha", f"alpha {self.alpha:g}, rotation_y {self.turn:g}: radians, -pi to pi"
            )
        elif abs(wrapped(self.alpha - expected)) > 0.02:
            self.fault(
                "alpha",
                f"alpha is {self.alpha:g}: rotation_y - atan2(x, z) is {expected:.4g}",
            )

    def _reprojection(self, size: tuple[int, int], P2: NdArray) -> None:
        """devkit_object/matlab/computeBox3D.m: x along the length, y down from the bottom face."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        x = np.array([1, 1, -1, -1, 1, 1, -1, -1]) * self.length / 2
        z = np.array([1, -1, -1, 1, 1, -1, -1, 1]) * self.width / 2
        y = np.repeat([0.0, -self.height], 4)
        corners = np.stack([c * x + s * z, y, -s * x + c * z], axis=1) + self.place
        if (corners[:, 2] <= 0.05).any():
            return
        offset = np.linalg.solve(P2[:, :3], P2[:, 3])
        pixels = project(P2[:, :3], corners + offset)
        low, high = pixels.min(0), pixels.max(0)
        first, last = self.box[:2], self.box[2:]
        ratio = float(np.linalg.norm(high - low) / max(1.0, float(np.linalg.norm(last - first))))
        span = np.round([*low, *high], 1).tolist()
        loose = 1.5 + 0.01 * P2[0, 0] / self.place[2]  # files with two decimals
        whole = (low >= 0).all() and (high < size).all()
        outside = (first < low.clip(0) - loose).any() or (
            last > high.clip(None, size) + loose
        ).any()
        if ratio < 1 / 20 or (whole and ratio > 20):
            self.fault(
                "units",
                f"the 3D box spans {span}, {ratio:.2g} times bbox: size and place are in metres",
            )
        elif outside or (whole and ((last - first + 1) < 0.2 * (high - low) - 2).any()):
            self.fault(
                "reprojection",
                f"the 3D box spans {span} by P2, and bbox is {self.box.tolist()}: x, y, z is the "
                "centre of the bottom face, sizes are height, width, length",
            )


FORMAT = Format("kitti", "KITTI", "training/label_2, flow_occ or disp_occ_0", CHECKS, found, tasks)
