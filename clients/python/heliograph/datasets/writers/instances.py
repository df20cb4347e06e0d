"""Labelled instances as the writers of poses need them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..._wire.arrays import Columns, NdArray
from ...errors import InvalidArgument, NotFound
from ...render.frame import Frame


@dataclass(frozen=True)
class Instance:
    """Instance: one row of the labels of a frame."""

    labels: Columns
    row: int
    category: str

    @property
    def label(self) -> int:
        return int(self.labels["label"][self.row])

    @property
    def name(self) -> str:
        return str(self.labels["name"][self.row])

    @property
    def camera_from_object(self) -> NdArray:
        """(4, 4) float64 rigid, OpenCV camera, metres; InvalidArgument if the parents shear or
        mirror it."""
        return self._rigid("camera_from_object_cv")

    @property
    def world_from_object(self) -> NdArray:
        """(4, 4) float64 rigid, metres."""
        return self._rigid("world_from_object")

    def _rigid(self, column: str) -> NdArray:
        if not self.labels["rigid"][self.row]:
            raise InvalidArgument(
                f"{self.name}: its parents shear or mirror it, so that no rotation is its pose; "
                "scale meshes and parents evenly, or leave its category out with categories=[...]",
                field="rigid",
            )
        return np.asarray(self.labels[column][self.row], np.float64)

    @property
    def corners(self) -> NdArray:
        """(8, 3) float64: the corners of its box in the object frame, metres; corner i has the
        upper x where i & 1, y where i & 2, z where i & 4."""
        center = self.labels["box_center"][self.row].astype(np.float64)
        half = self.labels["box_half_extents"][self.row].astype(np.float64)
        return np.asarray(center + half * CORNER_SIGNS)

    def number(self, column: str) -> float:
        return float(self.labels[column][self.row])

    def box(self, column: str) -> list[int]:
        """[x0, y0, x1, y1), pixels."""
        return [int(v) for v in self.labels[column][self.row]]


CORNER_SIGNS = np.array([[1.0 if i & bit else -1.0 for bit in (1, 2, 4)] for i in range(8)])


def instances(frame: Frame, categories: Sequence[str] | None) -> Iterator[Instance]:
    """The instances of these categories, None: of any, in the order of their labels."""
    labels = frame.labels
    for row, category in enumerate(labels["category"]):
        name = frame.categories.get(int(category), "")
        if name and (categories is None or name in categories):
            yield Instance(labels, row, name)


def check_categories(known: dict[int, str], wanted: Sequence[str] | None) -> None:
    """Refuses a writer of objects where the scene has none, and names that it does not have."""
    if not known:
        raise InvalidArgument(
            "categories: no instance of the scene has one; give entities category='...'",
            field="categories",
        )
    unknown = [name for name in wanted or () if name not in known.values()]
    if unknown:
        have = ", ".join(known.values())
        raise NotFound(f"categories: none is called {unknown[0]!r}; there are {have}")


def quaternion_wxyz(rotation: NdArray) -> NdArray:
    """(4,) float64 unit, w >= 0, of a (3, 3) rotation (Shepperd 1978)."""
    m = np.asarray(rotation, np.float64)
    squares = np.array([m.trace(), m[0, 0], m[1, 1], m[2, 2]])
    best = int(np.argmax(squares))
    if best == 0:
        q = [1 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    else:
        i = best - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0, 0.0, 0.0, 0.0]
        q[0] = m[k, j] - m[j, k]
        q[1 + i] = 1 + m[i, i] - m[j, j] - m[k, k]
        q[1 + j] = m[j, i] + m[i, j]
        q[1 + k] = m[k, i] + m[i, k]
    out = np.array(q) / np.linalg.norm(q)
    return np.asarray(-out if out[0] < 0 else out)


def wrapped(angle: float) -> float:
    """Angle, radians, within [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
