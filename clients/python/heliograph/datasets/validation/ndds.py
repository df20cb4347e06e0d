"""NDDS, as DOPE reads it: a JSON file of poses and cuboids beside each picture.

Format: Deep_Object_Pose, data_generation/readme.md (NVlabs): metres, camera x right, y down, z
forward; the model x forward, y left, z up.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import (
    LIST,
    NUMBER,
    TEXT,
    batches,
    check_size,
    fields_of,
    files,
    numbers,
    read_object,
    wanted_count,
)
from .formats import Format, Task
from .geometry import is_unit, project, rotation_fault, rotation_of
from .report import Faults, Malformed

CHECKS = {
    "format": "JSON files have camera_data and objects with class, location, quaternion_xyzw, "
    "projected_cuboid, visibility",
    "image_files": "a picture of the camera's width and height is beside each file",
    "counts": "each picture has a file, as many as the data set was to have",
    "camera": "intrinsics are positive, camera_view_matrix is rigid",
    "quaternion": "quaternion_xyzw has length 1",
    "visibility": "is within 0 to 1",
    "behind": "location's z is positive",
    "cuboid": "cuboids have 9 points, the ninth their centroid",
    "cuboid_order": "front left bottom, front right bottom, front right top, front left top, the "
    "same at the rear; x forward, y left, z up",
    "poses": "camera_view_matrix times local_to_world_matrix is location and quaternion",
    "units": "location, matrices and local_cuboid are in metres",
    "reprojection": "projected_cuboid is the projection of a cuboid at location and quaternion, "
    "within 1 px",
}
SIGNS = np.array(
    [(x, y, z) for x in (1, -1) for y, z in ((1, -1), (-1, -1), (-1, 1), (1, 1))], float
)
_OBJECT = {
    "class": TEXT,
    "location": numbers(3),
    "quaternion_xyzw": numbers(4),
    "projected_cuboid": LIST,
    "visibility": NUMBER,
}


def found(root: Path) -> bool:
    path = next(filter(_beside, _described(root)), None)
    if path is None:
        return False
    content = read_object(path)
    return "objects" in content and "camera_data" in content


def _described(root: Path) -> Iterator[Path]:
    """Files of pictures, without those of the whole set, such as _object_settings.json."""
    for path in files(root, ".json"):
        if path.name[0] != "_" and path.name != "model_info.json":
            yield path


def _beside(path: Path) -> Path | None:
    """The picture of a file."""
    return next((p for e in (".png", ".jpg") if (p := path.with_suffix(e)).is_file()), None)


def tasks(root: Path, faults: Faults) -> Iterator[Task]:
    count = 0
    for batch in batches(_described(root), 32):
        count += len(batch)
        yield partial(check_files, batch)
    for picture in files(root, ".png", ".jpg"):
        if not picture.with_suffix(".json").is_file():
            faults.add(
                "counts", picture, "has no JSON file: one of a picture without objects has []"
            )
    wanted = wanted_count(root)
    if wanted is not None and count != wanted:
        faults.add("counts", root, f"has {count} JSON files, and the data set {wanted} images")


def check_files(paths: list[Path], faults: Faults) -> None:
    """Some files."""
    for path in paths:
        content = read_object(path)
        wrong = fields_of(content, {"objects": LIST})
        camera = content.get("camera_data")
        if wrong or not isinstance(camera, dict):
            raise Malformed(path, wrong or "has no camera_data: write it")
        K, view = _camera(path, camera, faults)
        for i, row in enumerate(content["objects"]):
            wrong = fields_of(row, _OBJECT)
            if wrong:
                faults.add("format", path, f"objects[{i}] {wrong}")
            else:
                _Object(path, i, row, faults).check(K, view)


def _camera(
    path: Path, camera: dict[str, Any], faults: Faults
) -> tuple[NdArray | None, NdArray | None]:
    """K (3, 3) and camera_view_matrix (4, 4), None where they are not there or wrong."""
    picture = _beside(path) or path.with_suffix(".png")
    if "width" in camera and "height" in camera:
        check_size(faults, "image_files", picture, (camera["width"], camera["height"]), path.name)
    K = view = None
    inner = camera.get("intrinsics")
    if inner is not None:
        wrong = fields_of(inner, dict.fromkeys(("fx", "fy", "cx", "cy"), NUMBER))
        if wrong or min(inner["fx"], inner["fy"]) <= 0:
            faults.add("camera", path, f"intrinsics {wrong or 'have no positive fx, fy'}")
        else:
            K = np.array([[inner["fx"], 0, inner["cx"]], [0, inner["fy"], inner["cy"]], [0, 0, 1]])
    if "camera_view_matrix" in camera:
        view = np.array(camera["camera_view_matrix"], float)
        wrong = "is not 4x4" if view.shape != (4, 4) else rotation_fault(view[:3, :3])
        if not wrong and list(view[3]) != [0, 0, 0, 1]:
            wrong = "has its translation in the last row: it is a list of rows, for column vectors"
        if wrong:
            faults.add("camera", path, f"camera_view_matrix {wrong}")
            view = None
    return K, view


class _Object:
    def __init__(self, path: Path, index: int, row: dict[str, Any], faults: Faults) -> None:
        self.path, self.row, self.faults = path, row, faults
        self.name = f"objects[{index}] ({row['class']})"
        self.location = np.array(row["location"], float)

    def fault(self, check: str, message: str) -> None:
        self.faults.add(check, self.path, f"{self.name}: {message}")

    def check(self, K: NdArray | None, view: NdArray | None) -> None:
        row = self.row
        if not 0 <= row["visibility"] <= 1:
            self.fault("visibility", f"visibility is {row['visibility']:g}: needs 0 to 1")
        if not is_unit(row["quaternion_xyzw"]):
            self.fault(
                "quaternion",
                f"quaternion_xyzw {row['quaternion_xyzw']} has length "
                f"{np.linalg.norm(row['quaternion_xyzw']):.4g}: needs 1",
            )
            return
        if self.location[2] <= 0:
            self.fault("behind", f"location is {self.location.tolist()}: the camera looks at +z")
            return
        rotation = rotation_of(row["quaternion_xyzw"], "xyzw")
        good = self._matrices(rotation, view)
        cuboids = {name: self._cuboid(name) for name in ("projected_cuboid", "local_cuboid")}
        flat, local = cuboids["projected_cuboid"], cuboids["local_cuboid"]
        if local is not None and not self._local(local):
            return
        if good and K is not None and flat is not None:
            self._projected(K, rotation, flat, local)

    def _cuboid(self, name: str) -> NdArray | None:
        """(9, 2) or (9, 3)."""
        columns = 2 if name[0] == "p" else 3
        if name not in self.row:
            return None
        points = np.array(self.row[name], float)
        if points.shape != (9, columns):
            self.fault("cuboid", f"{name} has shape {points.shape}: needs (9, {columns})")
            return None
        return points

    def _local(self, local: NdArray) -> bool:
        """Is local_cuboid in DOPE's order and in metres?"""
        middle = local[:8].mean(0)
        if np.abs(local[8] - middle).max() > 1e-3 * np.ptp(local[:8], axis=0).max():
            self.fault("cuboid", f"local_cuboid's ninth point is {local[8]}: needs {middle}")
            return False
        if (np.sign((local[:8] - middle).round(9)) * SIGNS < 0).any():
            self.fault(
                "cuboid_order",
                f"local_cuboid begins with {local[0].tolist()}: needs front left bottom, "
                "+x +y -z, as docs of DOPE draw it (NViSII's example has y and z turned round)",
            )
            return False
        return True

    def _matrices(self, rotation: NdArray, view: NdArray | None) -> bool:
        if view is None or "local_to_world_matrix" not in self.row:
            return True
        world = np.array(self.row["local_to_world_matrix"], float)
        if world.shape != (4, 4):
            self.fault("poses", f"local_to_world_matrix has shape {world.shape}: needs (4, 4)")
            return False
        pose = view @ world
        far = float(np.linalg.norm(pose[:3, 3])) / float(np.linalg.norm(self.location))
        if not 1 / 30 < far < 30:
            self.fault(
                "units",
                f"location is {self.location.tolist()}, and the matrices say "
                f"{pose[:3, 3].round(4).tolist()}: all are in metres",
            )
            return False
        within = 1e-3 * float(np.linalg.norm(self.location)) + 1e-4
        if np.abs(pose[:3, 3] - self.location).max() > within or (
            np.abs(pose[:3, :3] - rotation).max() > 2e-3
        ):
            self.fault(
                "poses",
                f"location {self.location.tolist()} and quaternion_xyzw are not those of "
                "camera_view_matrix times local_to_world_matrix",
            )
            return False
        return True

    def _projected(
        self, K: NdArray, rotation: NdArray, flat: NdArray, local: NdArray | None
    ) -> None:
        center, half, error = _fitted(K, rotation, flat[:8])
        if error > 1:
            self.fault(
                "reprojection",
                f"projected_cuboid is up to {error:.1f} px from any cuboid's of this "
                "quaternion_xyzw in DOPE's order",
            )
            return
        scale = float(self.location @ center) / float(center @ center)
        center, half = scale * center, scale * half
        if (half < -1e-6).any():
            self.fault(
                "cuboid_order",
                f"projected_cuboid is of a cuboid of half extents {half.round(4).tolist()}: its "
                "corners are in another order, or the model is not x forward, y left, z up",
            )
            return
        middle = project(K, center[None])[0]
        if np.abs(middle - flat[8]).max() > 1:
            self.fault("cuboid", f"its ninth point is {flat[8].tolist()}: the centroid is {middle}")
        elif np.linalg.norm(center - self.location) > 2 * np.linalg.norm(half):
            self.fault(
                "reprojection",
                f"location is {self.location.tolist()}, projected_cuboid lies about "
                f"{center.round(4).tolist()}",
            )
        elif local is not None:
            self._as_local(K, rotation, flat, (local, half))

    def _as_local(
        self, K: NdArray, rotation: NdArray, flat: NdArray, cuboid: tuple[NdArray, NdArray]
    ) -> None:
        """Is it local_cuboid that is seen? cuboid: that, and the half extents by its projection."""
        local, half = cuboid
        stated_half = np.ptp(local[:8], axis=0) / 2
        ratio = float(np.linalg.norm(stated_half) / np.linalg.norm(half))
        error = np.abs(project(K, local @ rotation.T + self.location) - flat).max()
        if not 1 / 30 < ratio < 30:
            self.fault(
                "units",
                f"local_cuboid is {ratio:.3g} times the cuboid that is seen: it is in metres",
            )
        elif error > 1:
            self.fault(
                "reprojection",
                f"projected_cuboid is up to {error:.1f} px from where local_cuboid is seen at this "
                "location and quaternion_xyzw",
            )


def _fitted(K: NdArray, rotation: NdArray, flat: NdArray) -> tuple[NdArray, NdArray, float]:
    """(centre in the camera's frame, half extents, largest distance in px) of the cuboid whose
    corners are seen at flat (8, 2); its size is not known, as a large one far away looks the same.

    A corner is c + R s h; that it is seen at (u, v) is two homogeneous linear equations in c and h.
    """
    rows = []
    rays = np.column_stack([flat, np.ones(8)]) @ np.linalg.inv(K).T
    for sign, ray in zip(SIGNS, rays):
        for axis in (0, 1):
            plane = -np.eye(3)[axis]
            plane[2] = ray[axis]
            rows.append(np.concatenate([plane, (plane @ rotation) * sign]))
    solution = np.linalg.svd(np.array(rows))[2][-1]
    solution = solution * np.sign(solution[2])
    center, half = solution[:3], solution[3:]
    points = center + (SIGNS * half) @ rotation.T
    if (points[:, 2] <= 1e-9).any():
        return center, half, float("inf")
    return center, half, float(np.linalg.norm(project(K, points) - flat, axis=1).max())


FORMAT = Format(
    "ndds", "NDDS / DOPE", "000000.json with camera_data and objects", CHECKS, found, tasks
)
