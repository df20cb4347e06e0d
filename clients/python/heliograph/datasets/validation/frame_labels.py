"""Label rows of a saved frame: relations between their columns. Used by exr.py, webdataset.py and
parquet.py."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .files import INTEGER, LIST, fields_of
from .geometry import rotation_fault
from .lens import RAY_TABLE, Lens, lens_of, stated

CHECKS = {
    "camera": "K has positive focal lengths and brings points to their pixels, "
    "camera_from_world_cv is rigid and that of positions and rows",
    "labels": "labels are there once and from 1, keypoints are of instances that are there",
    "poses": "world_from_object is rigid, camera_from_object_cv is camera_from_world_cv times it",
    "corners": "corners_camera are those of the box at its pose, corners_image their projection",
    "boxes": "x0 <= x1, y0 <= y1; visible within amodal within the image, within the canvas' box; "
    "0 without pixels; no fewer pixels than visible",
    "visibility": "visible <= inside <= canvas; visibility is visible / canvas, occlusion "
    "1 - visible / inside, truncation 1 - inside / canvas, 0 / 0 is 0",
    "keypoints": "state is 0 to 3, image the projection of position_camera, within the image "
    "unless it is outside (0)",
}
Report = Callable[[str, str], None]
_ROW = {"label": INTEGER, "world_from_object": LIST, "camera_from_object_cv": LIST}
_BITS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) * 2.0 - 1


class Shot:
    """Labels of one image. content: width, height, K, camera_from_world_cv, by rows; projection and
    distortion, where they are there. report, leave: take a fault, and a check that cannot be
    made."""

    def __init__(self, content: dict[str, Any], report: Report, leave: Report) -> None:
        self.report, self.leave = report, leave
        self.size = int(content["width"]), int(content["height"])
        self.K = np.array(content["K"], float).reshape(3, 3)
        self.pose = np.array(content["camera_from_world_cv"], float).reshape(4, 4)
        self.lens: Lens | None = None
        self.named = stated(content, self.K)
        self.rolls = bool(content.get("rolling"))  # each row has a pose of its own then
        wrong = rotation_fault(self.pose[:3, :3])
        focal = self.K[0, 0] > 0 and self.K[1, 1] > 0
        self.has_table = content.get("projection") == RAY_TABLE  # and no focal length
        self.good = not wrong and (focal or self.has_table)
        if wrong:
            report("camera", f"camera_from_world_cv {wrong}")
        elif not self.good:
            report("camera", f"K is {self.K.tolist()}: needs positive focal lengths")

    def learn_lens(self, points: NdArray, pixels: NdArray, within: float) -> Lens:
        """Lens that shows points (N, 3) at pixels (N, 2). Once found it stays."""
        if self.lens is None:
            self.lens = lens_of(self.named, self.K, points, (pixels, within))
            if self.lens.kind == "other":
                self._other_lens()
            elif not self.lens.stated:
                seen = self.lens.K
                self.report(
                    "camera",
                    f"K has fx, fy, cx, cy {_four(self.K)}, and the points give {_four(seen)}: "
                    "it is of the rendered size, integers are pixel centres",
                )
        return self.lens

    def may_see(self, points: NdArray, beyond: float = 0.0) -> NdArray:
        """True per point (N,) that the lens may show, as Lens.sees."""
        return (self.lens or self.named or Lens("perspective", self.K)).sees(points, beyond)

    def _other_lens(self) -> None:
        if self.named is None or self.has_table:
            reason = "the points fit no pinhole, and the file has no projection and distortion"
            if self.has_table:
                reason = "a ray table gives no place in the image"
            for check in ("corners", "keypoints"):
                self.leave(check, f"{reason}: places in the image are not looked at")
        else:
            kind, distortion = self.named.kind, list(self.named.distortion)
            self.report(
                "camera",
                f"projection {kind} with distortion {distortion} does not bring points to their "
                "pixels, for any K: write the lens of this camera",
            )


def _four(K: NdArray) -> list[float]:
    return [round(float(v), 3) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]


def check_labels(
    shot: Shot, instances: list[dict[str, Any]], keypoints: list[dict[str, Any]]
) -> None:
    """instances, keypoints: rows; columns that are not there are not looked at."""
    report = shot.report
    labels = Counter(row.get("label") for row in instances)
    for label, times in labels.items():
        if times > 1 or not isinstance(label, int) or label < 1:
            report("labels", f"label {label!r} is there {times} times: one row each, from 1")
    good = []
    for row in instances:
        wrong = fields_of(row, _ROW)
        if wrong:
            report("format", f"an instance {wrong}")
        else:
            good.append(row)
    if shot.good:
        if _check_poses(shot, good):
            _check_corners(shot, good)
        _check_keypoints(shot, keypoints, set(labels))
    for row in good:
        name = f"label {row['label']}"
        for wrong in _wrong_boxes(row, shot.size):
            report("boxes", f"{name}: {wrong}")
        for wrong in _wrong_shares(row):
            report("visibility", f"{name}: {wrong}")


def matrix(row: dict[str, Any], name: str) -> NdArray:
    """(4, 4)."""
    return np.array(row[name], float).reshape(4, 4)


def _check_poses(shot: Shot, rows: list[dict[str, Any]]) -> bool:
    """Can the boxes be looked at?"""
    off = []
    for row in rows:
        world, camera = (matrix(row, n) for n in ("world_from_object", "camera_from_object_cv"))
        wrong = rotation_fault(world[:3, :3]) or rotation_fault(camera[:3, :3])
        if wrong:
            shot.report("poses", f"label {row['label']}: its pose {wrong}")
            return False
        seen = camera @ np.linalg.inv(world)  # the camera's pose by this row
        scale = 1 + float(np.abs(world[:3, 3]).max())
        if np.abs(seen - shot.pose).max() > 1e-4 * scale:
            off.append((row["label"], seen))
    same = all(np.abs(seen - off[0][1]).max() < 1e-3 for _, seen in off)
    if len(off) > 1 and len(off) == len(rows) and same:
        shot.report(
            "camera",
            f"camera_from_world_cv is {shot.pose[:3].round(4).tolist()}, the instances' poses "
            f"give {off[0][1][:3].round(4).tolist()}",
        )
        return True
    for label, _ in off:
        shot.report(
            "poses",
            f"label {label}: camera_from_object_cv is not camera_from_world_cv times "
            "world_from_object: write the poses of one time",
        )
    return not off


def _check_corners(shot: Shot, rows: list[dict[str, Any]]) -> None:
    seen_at: list[NdArray] = []
    for row in rows:
        if "corners_camera" not in row or "box_half_extents" not in row:
            return
        stated_corners = _points(row["corners_camera"], 3)
        pose = matrix(row, "camera_from_object_cv")
        half = np.array(row["box_half_extents"], float)
        points = (np.array(row["box_center"], float) + _BITS * half) @ pose[:3, :3].T + pose[:3, 3]
        known = np.isfinite(stated_corners).all(1)
        within = 1e-4 * (1 + float(np.abs(points).max()))
        if known.any() and np.abs(stated_corners - points)[known].max() > within:
            far = float(np.abs(stated_corners - points)[known].max())
            shot.report(
                "corners",
                f"label {row['label']}: corners_camera are up to {far:.4g} m from box_center +- "
                "box_half_extents at its pose (corner i has the upper x where i & 1, y i & 2, "
                "z i & 4; metres)",
            )
            return
        if "corners_image" in row:
            pixels = _points(row["corners_image"], 2)
            both = known & np.isfinite(pixels).all(1) & shot.may_see(points, 0.05)
            seen_at.append(np.column_stack([points[both], pixels[both]]))
    if not seen_at:
        return
    table = np.concatenate(seen_at)
    lens = shot.learn_lens(table[:, :3], table[:, 3:], 0.05)
    if lens.kind == "other" or not len(table):
        return
    error = np.abs(lens.project(table[:, :3]) - table[:, 3:]).max(1)
    if error.max() > 0.1:
        shot.report(
            "corners",
            f"corners_image are up to {error.max():.4g} px from the projection of corners_camera",
        )


def _points(values: Any, columns: int) -> NdArray:
    """(N, columns) of nested or flat numbers; None is nan."""
    flat: list[float] = []
    _flatten(values, flat)
    return np.array(flat, float).reshape(-1, columns)


def _flatten(values: Any, out: list[float]) -> None:
    for value in values:
        if isinstance(value, (list, tuple, np.ndarray)):
            _flatten(value, out)
        else:
            out.append(float("nan") if value is None else float(value))


def _wrong_boxes(row: dict[str, Any], size: tuple[int, int]) -> list[str]:
    names = [n for n in ("bbox_visible", "bbox_amodal", "bbox_amodal_canvas") if n in row]
    out = []
    for name, count in zip(names, ("visible", "inside", "canvas")):
        x0, y0, x1, y1 = box = [int(v) for v in row[name]]
        pixels = row.get(count, 0)
        if x0 > x1 or y0 > y1:
            out.append(f"{name} is {box}: needs x0 <= x1 and y0 <= y1, half open")
        elif count != "canvas" and (x0 < 0 or y0 < 0 or x1 > size[0] or y1 > size[1]):
            out.append(f"{name} is {box}: needs to be within {size[0]}x{size[1]}")
        elif (x1 - x0) * (y1 - y0) < pixels:
            out.append(f"{name} is {box}, smaller than the {pixels} pixels that it bounds")
        elif not pixels and count in row and box != [0, 0, 0, 0]:
            out.append(f"{name} is {box}, without a pixel it is 0, 0, 0, 0")
    for inner, outer in zip(names, names[1:]):
        a, b = row[inner], row[outer]
        empty = a[0] == a[2]
        if not empty and (a[0] < b[0] or a[1] < b[1] or a[2] > b[2] or a[3] > b[3]):
            out.append(f"{inner} {list(a)} is not within {outer} {list(b)}")
    return out[:1]


def _wrong_shares(row: dict[str, Any]) -> list[str]:
    if not {"visible", "inside", "canvas"} <= set(row):
        return []
    visible, inside, canvas = (int(row[name]) for name in ("visible", "inside", "canvas"))
    if not 0 <= visible <= inside <= canvas:
        return [f"visible {visible}, inside {inside}, canvas {canvas}: needs them in this order"]
    expected = {
        "visibility": visible / canvas if canvas else 0.0,
        "occlusion": 1 - visible / inside if inside else 0.0,
        "truncation": 1 - inside / canvas if canvas else 0.0,
    }
    return [
        f"{name} is {row[name]:.6g}: its pixels ({visible}, {inside}, {canvas}) give {value:.6g}"
        for name, value in expected.items()
        if name in row and abs(row[name] - value) > 1e-5
    ]


def _check_keypoints(shot: Shot, rows: list[dict[str, Any]], labels: set[Any]) -> None:
    width, height = shot.size
    lens = shot.lens or shot.named
    if rows and lens is None:
        shot.leave("keypoints", "the lens is not known: places in the image are not looked at")
    for row in rows:
        name = f"keypoint {row.get('name')} of label {row.get('label')}"
        if row.get("label") not in labels:
            shot.report("labels", f"{name}: no instance has this label")
        if row.get("state") not in (0, 1, 2, 3):
            shot.report("keypoints", f"{name}: state is {row.get('state')!r}: needs 0 to 3")
            continue
        point = _points(row["position_camera"], 3)
        pixel = _points(row["image"], 2)
        if not np.isfinite(pixel).all():
            if row["state"]:
                shot.report("keypoints", f"{name}: has no place in the image, and is not outside")
            continue
        x, y = pixel[0]
        if row["state"] and not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            shot.report("keypoints", f"{name}: {x:.2f}, {y:.2f} is outside: its state is 0")
        if lens and lens.kind != "other" and lens.sees(point)[0]:
            error = float(np.abs(lens.project(point) - pixel).max())
            if error > 0.1:
                shot.report(
                    "keypoints", f"{name}: is {error:.3g} px from the projection of its position"
                )
