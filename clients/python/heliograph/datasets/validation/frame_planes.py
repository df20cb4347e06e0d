"""Planes of a saved frame: the invariants of docs/planes.md. Used by exr.py and webdataset.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from .camera_motion import flow_error
from .frame_labels import Shot, matrix
from .geometry import rotation_fault
from .masks import extent
from .row_poses import RowPoses, middle_error

CHECKS = {
    "sizes": "planes are width x height",
    "radiance": "beauty is finite and not negative, its alpha 0 to 1",
    "depth": "depth is the z of position_camera, +inf where nothing is hit",
    "distance": "distance is the length of position_camera (orthographic: the depth)",
    "positions": "camera_from_world_cv brings position to position_camera; with a rolling shutter "
    "a rigid motion for each row does, and in the middle row it is that",
    "projection": "position_camera projects to its pixel's centre within 0.01 px, by K, projection "
    "and distortion",
    "normals": "normals are unit, 0 where nothing is hit; normal_camera is normal turned; "
    "geometric_normal faces the viewer",
    "instance": "the ids are those of the rows, visible counts their pixels",
    "masks": "bbox_visible is the extent of an instance's pixels, half open",
    "semantic": "pixels of an instance have its category's id, others 0",
    "part": "is 1 or more on an instance, else 0",
    "nocs": "nocs is 0.5 + (object point - box_center) / box diagonal",
    "object_points": "world_from_object brings the point of object_coordinates to position (for "
    "rigid instances)",
    "flow": "there is one camera pose in which position + scene_flow is seen where flow_forward "
    "leads, within 0.05 px",
    "flow_visible": "flow to a visible point is valid and leads into the image",
    "disparity": "disparity times depth is one number, focal length times baseline",
}
_NO_LENS = "the points fit no pinhole, and the file has no projection and distortion"
_PIXEL = 0.01  # px
_FLOW = 0.05  # px


class Planes:
    """planes: name to (H, W) or (H, W, C). rows: label to its row."""

    def __init__(self, planes: dict[str, NdArray], shot: Shot, rows: dict[int, Any]) -> None:
        self.planes, self.shot, self.rows = planes, shot, rows
        self.report = shot.report
        turn = np.full((3, 3), np.nan) if shot.rolls else shot.pose[:3, :3]
        self.turns = np.broadcast_to(turn, (shot.size[1], 3, 3))  # of each row

    def check(self) -> bool:
        """Are they the frame's?"""
        width, height = self.shot.size
        for name, plane in self.planes.items():
            if plane.shape[:2] != (height, width):
                self.report(
                    "sizes",
                    f"{name} is {plane.shape[1]}x{plane.shape[0]}: the frame is {width}x{height}",
                )
                return False
        self._radiance()
        self._ids()
        if "position_camera" in self.planes and self.shot.good:
            self._positions()
        self._normals()
        self._nocs()
        self._flow_visible()
        self._disparity()
        return True

    def _get(self, name: str) -> NdArray | None:
        plane = self.planes.get(name)
        return None if plane is None else plane.astype(np.float64)

    def _radiance(self) -> None:
        beauty = self._get("beauty")
        if beauty is None:
            return
        bad = ~np.isfinite(beauty).all(2) | (beauty[..., :3] < 0).any(2)
        if beauty.shape[2] == 4:
            bad |= (beauty[..., 3] < -1e-6) | (beauty[..., 3] > 1 + 1e-4)
        if bad.any():
            y, x = np.argwhere(bad)[0]
            self.report(
                "radiance",
                f"beauty at {x}, {y} is {beauty[y, x].tolist()} (and {int(bad.sum()) - 1} more): "
                "needs finite radiance >= 0 and alpha 0 to 1",
            )

    # ------------------------------------------------------------ geometry

    def _positions(self) -> None:
        camera = self.planes["position_camera"].astype(np.float64)
        hit = np.asarray(np.isfinite(camera).all(2))
        y, x = np.nonzero(hit)
        points, pixels = camera[hit], np.column_stack([x, y]).astype(float)
        if not len(points):
            return
        self._depth(camera, hit)
        before = self.shot.may_see(points)
        lens = self.shot.learn_lens(points[before], pixels[before], _PIXEL)
        if lens.kind == "other":
            if self.shot.named is None or self.shot.has_table:
                self.shot.leave("projection", _NO_LENS)
        else:
            error = np.abs(lens.project(points[before]) - pixels[before]).max(1)
            self._worst(
                "projection",
                (pixels[before], error, _PIXEL),
                "px from where position_camera projects to",
            )
        self._distance(points, pixels, lens.kind)
        position = self._get("position")
        if position is None:
            return
        if self.shot.rolls and self.shot.has_table:
            self.shot.leave("positions", "each pixel has a pose of its own")
        elif self.shot.rolls:
            self._rows(position, camera, hit)
        else:
            self._world(position[hit], points, pixels)
        self._flow(position, hit)

    def _worst(self, check: str, at: tuple[NdArray, NdArray, float | NdArray], words: str) -> None:
        """Reports the worst pixel beyond its bound. at: pixels (N, 2), errors, bounds."""
        pixels, error, within = at
        off = ~(error <= within)
        if off.any():
            worst = int(np.where(off, np.nan_to_num(error, nan=np.inf), -1).argmax())
            x, y = pixels[worst].astype(int)
            self.report(
                check, f"pixel {x}, {y} is {error[worst]:.4g} {words} ({int(off.sum())} are off)"
            )

    def _depth(self, camera: NdArray, hit: NdArray) -> None:
        depth = self._get("depth")
        if depth is None:
            return
        y, x = np.nonzero(np.ones_like(hit))
        with np.errstate(invalid="ignore"):
            error = np.where(hit, np.abs(depth - camera[..., 2]), np.where(depth > 1e30, 0, np.inf))
        within = np.where(hit, 1e-5 + 1e-5 * np.abs(camera[..., 2]), 0.0)
        self._worst(
            "depth",
            (np.column_stack([x, y]), error.ravel(), np.nan_to_num(within.ravel())),
            "m from the z of position_camera: depth is along the optical axis, in metres",
        )

    def _distance(self, points: NdArray, pixels: NdArray, kind: str) -> None:
        distance = self._get("distance")
        if distance is None or self.shot.has_table:  # whose rays begin anywhere
            return
        x, y = pixels.astype(int).T
        expected = points[:, 2] if kind == "orthographic" else np.linalg.norm(points, axis=1)
        error = np.abs(distance[y, x] - expected)
        within = 1e-4 + 1e-5 * expected
        self._worst("distance", (pixels, error, within), "m from the length of position_camera")

    def _world(self, position: NdArray, points: NdArray, pixels: NdArray) -> None:
        pose = self.shot.pose
        seen = position @ pose[:3, :3].T + pose[:3, 3]
        error = np.abs(seen - points).max(1)
        within = 1e-4 + 1e-5 * np.abs(position).max(1) + 1e-5 * np.abs(points).max(1)
        off = ~(error <= within)
        if off.mean() <= 0.8:
            words = "m from camera_from_world_cv times position"
            self._worst("positions", (pixels, error, within), words)
        else:
            self.report(
                "camera",
                f"camera_from_world_cv brings position to {np.median(error):.4g} m from "
                "position_camera as a rule: write the pose of this frame",
            )

    def _rows(self, position: NdArray, camera: NdArray, hit: NdArray) -> None:
        """Checks the rows of a rolling shutter, each of which has a pose of its own."""
        within = 4e-4 + 4e-5 * (np.abs(position).max(2) + np.abs(camera).max(2))
        rows = RowPoses(position, camera, np.where(hit, within, np.inf))
        self.turns = rows.turns
        y, x = np.nonzero(hit)
        words = "m from where the best rigid motion of its row brings position"
        self._worst("positions", (np.column_stack([x, y]), rows.error[hit], within[hit]), words)
        pose = self.shot.pose
        error = np.abs(position @ pose[:3, :3].T + pose[:3, 3] - camera).max(2)
        found, even = middle_error(error, hit)
        if found > float(np.median(within[hit])) + even:
            self.report(
                "camera",
                f"camera_from_world_cv brings positions of the middle rows to {found:.4g} m from "
                "position_camera: of a rolling shutter write the pose of the middle row",
            )

    def _normals(self) -> None:
        hit = self._hit()
        for name in ("normal", "normal_camera", "geometric_normal"):
            plane = self._get(name)
            if plane is None:
                continue
            length = np.linalg.norm(plane, axis=2)
            bad = ~((np.abs(length - 1) < 1e-3) | (length == 0))
            if hit is not None:
                bad |= ~hit & (length != 0)
            if bad.any():
                y, x = np.argwhere(bad)[0]
                self.report(
                    "normals",
                    f"{name} at {x}, {y} has length {length[y, x]:.4g} ({int(bad.sum())} are off): "
                    "needs 1, and 0 where nothing is hit",
                )
                return
        world, camera = self._get("normal"), self._get("normal_camera")
        if world is not None and camera is not None and self.shot.good:
            self._leave_unknown_rows("normals", "normal_camera is not compared with normal")
            off = np.abs(self._turned(world) - camera).max(2) > 1e-3
            if 0 < off.mean() <= 0.8 * (camera != 0).any(2).mean():
                y, x = np.argwhere(off)[0]
                self.report("normals", f"normal_camera at {x}, {y} is not normal turned")
        flat, points = self._get("geometric_normal"), self._get("position_camera")
        if flat is not None and points is not None and self.shot.good:
            view = np.nan_to_num(points)
            if self.shot.lens and self.shot.lens.kind == "orthographic":
                view = np.where(np.isfinite(points), (0.0, 0.0, 1.0), 0.0)
            away = (self._turned(flat) * view).sum(2) > 1e-3 * (1 + np.linalg.norm(view, axis=2))
            if away.mean() > 0.001:
                self.report("normals", f"geometric_normal faces away at {int(away.sum())} pixels")

    def _turned(self, directions: NdArray) -> NdArray:
        """(H, W, 3) directions of the world as the camera sees them; nan where that is unknown."""
        return np.asarray(np.einsum("yij,yxj->yxi", self.turns, directions))

    def _leave_unknown_rows(self, check: str, what: str) -> None:
        unknown = int(np.isnan(self.turns).any((1, 2)).sum())
        if unknown:
            self.shot.leave(
                check, f"{what} in rows of a rolling shutter whose points do not give their pose"
            )

    def _hit(self) -> NdArray | None:
        depth = self._get("depth")
        return None if depth is None else np.isfinite(depth)

    # ------------------------------------------------------------ ids

    def _ids(self) -> None:
        ids = self.planes.get("instance")
        if ids is None:
            return
        labels, counts = np.unique(ids, return_counts=True)
        seen = dict(zip(labels.tolist(), counts.tolist()))
        seen.pop(0, None)
        for label in sorted(set(seen) - set(self.rows)):
            self.report("instance", f"{seen[label]} pixels have label {label}, which has no row")
        for label, row in self.rows.items():
            count = seen.get(label, 0)
            if row.get("visible", count) != count:
                self.report("instance", f"label {label}: visible is {row['visible']}: {count} are")
                continue
            box = list(extent(ids == label))
            if list(row.get("bbox_visible", box)) != box:
                own = list(row["bbox_visible"])
                self.report("masks", f"label {label}: bbox_visible is {own}: its pixels' is {box}")
        self._classes(ids)

    def _classes(self, ids: NdArray) -> None:
        semantic, part = self.planes.get("semantic"), self.planes.get("part")
        if semantic is not None:
            expected = np.zeros_like(semantic)
            for label, row in self.rows.items():
                expected[ids == label] = row.get("category_id", 0)
            off = semantic != expected
            if off.any():
                y, x = np.argwhere(off)[0]
                self.report(
                    "semantic",
                    f"{x}, {y} has class {semantic[y, x]}: its instance {ids[y, x]} has "
                    f"{expected[y, x]} ({int(off.sum())} are off)",
                )
        if part is not None:
            off = (part > 0) != (ids > 0)
            if off.any():
                y, x = np.argwhere(off)[0]
                self.report(
                    "part",
                    f"{x}, {y} has part {part[y, x]} of instance {ids[y, x]}: from 1, else 0",
                )

    def _nocs(self) -> None:
        ids, within_box = self.planes.get("instance"), self._get("object_coordinates")
        if ids is None or within_box is None:
            return
        nocs, position = self._get("nocs"), self._get("position")
        for label, row in self.rows.items():
            seen = (ids == label) & np.isfinite(within_box).all(2)
            if not seen.any() or "box_half_extents" not in row:
                continue
            half = np.array(row["box_half_extents"], float)
            inside = (within_box[seen] - 0.5) * 2 * half
            if nocs is not None:
                expected = 0.5 + inside / max(2 * float(np.linalg.norm(half)), 1e-12)
                error = float(np.abs(nocs[seen] - expected).max())
                if not error <= 1e-3:
                    self.report("nocs", f"label {label}: nocs is up to {error:.4g} off")
            if position is None or not row.get("rigid", 1) or not self.shot.good:
                continue
            if self.shot.rolls:
                self.shot.leave("object_points", "rolling shutter: rows see it at other times")
            else:
                center = np.array(row["box_center"], float)
                self._object_points(label, (center + inside, position[seen], within_box[seen]))

    def _object_points(self, label: int, what: tuple[NdArray, NdArray, NdArray]) -> None:
        """Checks that an instance that moves as one body, and is seen over half its box, is at
        its pose. Leaves out what deforms, and one part of many."""
        points, positions, shares = what
        pose = matrix(self.rows[label], "world_from_object")
        if rotation_fault(pose[:3, :3]):
            return  # a fault of the row
        off = positions - (points @ pose[:3, :3].T + pose[:3, 3])
        within = 1e-3 + 1e-4 * float(np.abs(positions).max())
        if np.abs(off).max() <= within or len(points) < 12:
            return
        spread = np.sort(np.ptp(shares, axis=0))
        if spread[1] < 0.5 or _rigid_residual(points, positions) > within:
            return
        self.report(
            "object_points",
            f"label {label}: its points are {np.abs(off).max():.4g} m from where world_from_object "
            "brings those of object_coordinates: the pose is not this frame's",
        )

    # ------------------------------------------------------------ two views

    def _flow(self, position: NdArray, hit: NdArray) -> None:
        flow, motion = self._get("flow_forward"), self._get("scene_flow")
        lens = self.shot.lens
        if flow is None or motion is None or lens is None:
            return
        if self.shot.rolls:
            return self.shot.leave("flow", "rolling shutter: rows of the other end have own poses")
        if lens.kind == "other":
            return self.shot.leave("flow", _NO_LENS)
        valid = self.planes.get("flow_forward_valid")
        known = hit & np.isfinite(flow).all(2) & np.isfinite(position + motion).all(2)
        if valid is not None:
            known &= valid > 0
        if known.sum() < 12:
            return
        y, x = np.nonzero(known)
        pixels = np.column_stack([x, y]).astype(float)
        error = flow_error(lens, self.shot.pose, (position + motion)[known], pixels + flow[known])
        words = "px from where position + scene_flow is seen: flow is there minus here, y down"
        self._worst("flow", (pixels, error, _FLOW), words)

    def _flow_visible(self) -> None:
        width, height = self.shot.size
        for name in ("flow_forward", "flow_backward"):
            flow, visible = self._get(name), self.planes.get(f"{name}_visible")
            if flow is None or visible is None:
                continue
            y, x = np.mgrid[:height, :width] + 0.5
            there = np.stack([x, y], axis=2) + flow
            off = (visible > 0) & ~(
                (there >= -0.01) & (there <= (width + 0.01, height + 0.01))
            ).all(2)
            valid = self.planes.get(f"{name}_valid")
            if valid is not None:
                off |= (visible > 0) & (valid == 0)
            if off.any():
                row, column = np.argwhere(off)[0]
                self.report(
                    "flow_visible",
                    f"{name} at {column}, {row} leads to {there[row, column].round(1).tolist()}: "
                    "there it is not visible, or it is not valid",
                )

    def _disparity(self) -> None:
        depth = self._get("depth")
        for name in self.planes:
            if not name.startswith("disparity") or "visible" in name or depth is None:
                continue
            hit = np.isfinite(depth) & (depth > 0)
            shift = self._get(name)
            if shift is None or not hit.any():
                continue
            product = float(np.median(shift[hit] * depth[hit]))
            y, x = np.nonzero(hit)
            error = np.abs(shift[hit] - product / depth[hit])
            words = f"px from {product:.4g} / depth"
            self._worst("disparity", (np.column_stack([x, y]), error, _FLOW), words)


def _rigid_residual(points: NdArray, positions: NdArray) -> float:
    """Largest distance, m, that the best rigid transform (Kabsch 1976) of points (N, 3) leaves to
    positions."""
    a, b = points - points.mean(0), positions - positions.mean(0)
    u, _, v = np.linalg.svd(a.T @ b)
    turn = (u * (1, 1, np.sign(np.linalg.det(u @ v)))) @ v
    return float(np.abs(a @ turn - b).max())
