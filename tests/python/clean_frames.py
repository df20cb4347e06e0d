"""A frame and its labels by arithmetic: two boxes before a moving camera. Used by the clean sets of
EXR, WebDataset and Parquet; faults to plant are in frame_faults.py."""

from __future__ import annotations

import copy
import functools

import numpy as np
from shapes_seen import BOX, HEIGHT, POSES, QUADS, WIDTH, K, turned

HALF = np.array([0.12, 0.07, 0.05])
CAMERA = np.eye(4)  # camera_from_world
CAMERA[:3, :3] = turned((1, 0.2, 0), 1.8)
CAMERA[:3, 3] = 0.1, -0.2, 0.3
LATER = np.eye(4)  # the same at the other end of the flow
LATER[:3, :3] = turned((0.1, 1, 0), 0.03) @ CAMERA[:3, :3]
LATER[:3, 3] = CAMERA[:3, 3] + (0.02, -0.01, 0.015)
BASELINE = 0.1


def poses() -> list[np.ndarray]:
    """world_from_object of both."""
    out = []
    for rotation, t in POSES:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, t
        out.append(np.linalg.inv(CAMERA) @ pose)
    return out


def moved() -> list[np.ndarray]:
    """The same at the other end of the flow: the second one has turned and gone."""
    first, second = poses()
    turn = np.eye(4)
    turn[:3, :3] = turned((0, 0, 1), 0.2)
    turn[:3, 3] = 0.02, 0.0, 0.01
    return [first, second @ turn]


def hits(pose: np.ndarray, pad: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth (inf beside it) and normal (camera) of a box, and the points hit (object)."""
    rows, columns = np.mgrid[-pad * HEIGHT : (1 + pad) * HEIGHT, -pad * WIDTH : (1 + pad) * WIDTH]
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(K).T
    seen = CAMERA @ pose
    depth = np.full(rows.shape, np.inf)
    normal = np.zeros((*rows.shape, 3))
    for quad in QUADS:
        a, b, c, _ = BOX[quad] @ seen[:3, :3].T + seen[:3, 3]
        out = np.cross(b - a, c - a)
        out /= np.linalg.norm(out)
        out *= -np.sign(out @ a)  # towards the viewer
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (a @ out) / (rays @ out)
        local = (rays * z[..., None] - seen[:3, 3]) @ seen[:3, :3]
        inside = (np.abs(local) <= HALF + 1e-9).all(-1) & (z > 0) & (z < depth)
        depth[inside], normal[inside] = z[inside], out
    points = (rays * np.where(np.isfinite(depth), depth, 0)[..., None] - seen[:3, 3]) @ seen[:3, :3]
    return depth, normal, points


def extent(mask: np.ndarray, pad: int = 0) -> list[int]:
    """x0, y0, x1, y1, half open."""
    x, y = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    if not len(x):
        return [0, 0, 0, 0]
    first = np.array([x[0], y[0]]) - np.array([WIDTH, HEIGHT]) * pad
    last = np.array([x[-1], y[-1]]) + 1 - np.array([WIDTH, HEIGHT]) * pad
    return [int(v) for v in (*first, *last)]


def projected(points: np.ndarray) -> np.ndarray:
    flat = points @ K.T
    return flat[..., :2] / flat[..., 2:]


def frame() -> dict[str, np.ndarray]:
    """Planes by name, to be changed as you like."""
    return {name: plane.copy() for name, plane in _frame().items()}


@functools.cache
def _frame() -> dict[str, np.ndarray]:
    shape = (HEIGHT, WIDTH)
    out = {"depth": np.full(shape, np.inf), "instance": np.zeros(shape, np.uint32)}
    for name, fill in (("position_camera", np.nan), ("position", np.nan), ("scene_flow", 0.0)):
        out[name] = np.full((*shape, 3), fill)
    for name, fill in (("normal_camera", 0.0), ("object_coordinates", np.nan), ("nocs", np.nan)):
        out[name] = np.full((*shape, 3), fill)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([columns, rows, np.ones(shape)], axis=-1) @ np.linalg.inv(K).T
    for i, (pose, later) in enumerate(zip(poses(), moved(), strict=True)):
        depth, normal, points = hits(pose)
        near = depth < out["depth"]
        world = points @ pose[:3, :3].T + pose[:3, 3]
        out["depth"][near], out["instance"][near] = depth[near], i + 1
        out["normal_camera"][near] = normal[near]
        out["position_camera"][near] = (rays * depth[..., None])[near]
        out["position"][near] = world[near]
        out["scene_flow"][near] = (points @ later[:3, :3].T + later[:3, 3] - world)[near]
        out["object_coordinates"][near] = (0.5 + points / (2 * HALF))[near]
        out["nocs"][near] = (0.5 + points / (2 * np.linalg.norm(HALF)))[near]
    return finished(out, np.stack([columns, rows], axis=-1))


def finished(out: dict[str, np.ndarray], pixels: np.ndarray) -> dict[str, np.ndarray]:
    """The planes that follow from the others."""
    hit = np.isfinite(out["depth"])
    out["distance"] = np.where(hit, np.linalg.norm(out["position_camera"], axis=2), np.inf)
    out["normal"] = out["normal_camera"] @ CAMERA[:3, :3]
    out["geometric_normal"] = out["normal"]
    out["semantic"] = out["instance"].copy()
    out["part"] = (out["instance"] > 0).astype(np.uint32)
    there = (out["position"] + out["scene_flow"]) @ LATER[:3, :3].T + LATER[:3, 3]
    flow = projected(np.where(hit[..., None], there, 1.0)) - pixels
    out["flow_forward"] = np.where(hit[..., None], flow, 0.0)
    out["flow_forward_valid"] = np.ones_like(out["part"])
    there = pixels + out["flow_forward"] + 0.5
    inside = ((there >= 0) & (there < (WIDTH, HEIGHT))).all(2)
    out["flow_forward_visible"] = (hit & inside).astype(np.uint32)
    out["disparity:right"] = np.where(hit, K[0, 0] * BASELINE / out["depth"], 0)
    out["beauty"] = np.full((HEIGHT, WIDTH, 4), 0.25)
    return {k: v.astype(np.float32) if v.dtype == float else v for k, v in out.items()}


def labels(index: int) -> dict:
    """The JSON beside it, to be changed as you like."""
    return {**copy.deepcopy(_labels()), "index": index}


@functools.cache
def _labels() -> dict:
    planes = _frame()
    rows, keypoints = [], []
    for i, pose in enumerate(poses()):
        whole, canvas = np.isfinite(hits(pose)[0]), np.isfinite(hits(pose, 1)[0])
        seen = planes["instance"] == i + 1
        bits = np.array([[b & 1, b >> 1 & 1, b >> 2] for b in range(8)]) * 2 - 1
        camera = CAMERA @ pose
        corners = (bits * HALF) @ camera[:3, :3].T + camera[:3, 3]
        v, n, c = int(seen.sum()), int(whole.sum()), int(canvas.sum())
        row = {"label": i + 1, "name": f"box{i}", "category": "box", "category_id": i + 1}
        row |= {"world_from_object": pose.tolist(), "camera_from_object_cv": camera.tolist()}
        row |= {"scale": [1, 1, 1], "rigid": 1, "crosses_camera_plane": 0}
        row |= {"box_center": [0, 0, 0], "box_half_extents": HALF.tolist()}
        row |= {"corners_camera": corners.tolist(), "corners_image": projected(corners).tolist()}
        row |= {"visible": v, "inside": n, "canvas": c}
        row |= {"visibility": v / c, "occlusion": 1 - v / n, "truncation": 1 - n / c}
        row |= {"bbox_visible": extent(seen), "bbox_amodal": extent(whole)}
        row["bbox_amodal_canvas"] = extent(canvas, 1)
        rows.append(row)
        tip = corners[0]
        place = projected(tip)
        inside = (place >= -0.5).all() and (place <= (WIDTH - 0.5, HEIGHT - 0.5)).all()
        keypoints.append({"label": i + 1, "name": "tip", "position_camera": tip.tolist()})
        keypoints[-1] |= {"image": place.tolist(), "state": 3 if inside else 0}
    shot = {"split": "", "camera": "cam", "width": WIDTH, "height": HEIGHT}
    shot |= {"time": 0.0, "K": K.tolist(), "camera_from_world_cv": CAMERA.tolist()}
    return {**shot, "instances": rows, "keypoints": keypoints}
