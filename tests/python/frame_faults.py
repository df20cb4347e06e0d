"""Faults to plant in the frame and labels of clean_frames.py: name to (check, function). A function
changes planes (name to array) and the label file's content; its result is ignored."""

from __future__ import annotations

import numpy as np
from clean_frames import CAMERA, LATER, frame, projected
from shapes_seen import HEIGHT, WIDTH, K

# ------------------------------------------------------------ of labels


def shot(**values):
    return lambda planes, content: content.update(values)


def row(change, index: int = 0):
    return lambda planes, content: change(content["instances"][index])


def values(**changed):
    return row(lambda r: r.update(changed))


def point(**changed):
    return lambda planes, content: content["keypoints"][0].update(changed)


def number(name: str, column: int, by: float):
    """Another number in the first row of a matrix."""

    def change(r) -> None:
        r[name][0][column] += by

    return row(change)


def mirrored(planes, content) -> None:
    content["camera_from_world_cv"][1] = [-v for v in CAMERA[1]]


def scaled(name: str, by: float):
    return row(lambda r: r.update({name: (by * np.array(r[name])).tolist()}))


LABEL_FAULTS = {
    "K of another size": ("camera", shot(K=[[120.0, 0, 47.3], [0, 122.0, 32.1], [0, 0, 1]])),
    "K with centres at .5": ("camera", shot(K=[[60.0, 0, 23.9], [0, 61.0, 16.3], [0, 0, 1]])),
    "camera of another frame": ("camera", shot(camera_from_world_cv=LATER.tolist())),
    "camera mirrored": ("camera", mirrored),
    "keypoint of nothing": ("labels", point(label=9)),
    "rotation scaled": ("poses", scaled("world_from_object", 2)),
    "pose of another time": ("poses", number("camera_from_object_cv", 3, 0.05)),
    "corners reversed": (
        "corners",
        row(lambda r: r.update(corners_camera=r["corners_camera"][::-1])),
    ),
    "corners farther away": ("corners", scaled("corners_camera", 1.02)),
    "a corner two pixels off": ("corners", number("corners_image", 0, 2.0)),
    "amodal box beyond the image": (
        "boxes",
        row(lambda r: r.update(bbox_amodal=[-3, *r["bbox_amodal"][1:]])),
    ),
    "amodal box within visible": (
        "boxes",
        row(lambda r: r.update(bbox_amodal=[r["bbox_visible"][0] + 2, *r["bbox_amodal"][1:]])),
    ),
    "box as width and height": ("boxes", values(bbox_amodal_canvas=[9, 9, 4, 4])),
    "visibility above 1": ("visibility", values(visibility=1.2)),
    "truncation of what is seen": ("visibility", values(truncation=0.5)),
    "more inside than on the canvas": (
        "visibility",
        row(lambda r: r.update(inside=r["canvas"] + 1)),
    ),
    "keypoint's state 5": ("keypoints", point(state=5)),
    "keypoint off its place": ("keypoints", point(image=[9.0, 9.0])),
}

# ------------------------------------------------------------ of planes


def somewhere() -> tuple[int, int]:
    """Row and column in the middle of the first box."""
    rows, columns = np.nonzero(frame()["instance"] == 1)
    return int(rows[len(rows) // 2]), int(columns[len(rows) // 2])


def pixel(name: str, change, without: tuple[str, ...] = ()):
    """Another value at one pixel. without: planes of the same content, taken away."""

    def plant(planes, content) -> None:
        planes[name][somewhere()] = change(planes[name][somewhere()])
        for other in without:
            planes.pop(other)

    return plant


def plane(name: str, change, without: tuple[str, ...] = ()):
    """Another plane, made from all of them."""

    def plant(planes, content) -> None:
        planes[name] = np.asarray(change(planes), planes[name].dtype)
        for other in without:
            planes.pop(other)

    return plant


def lent(planes, content) -> None:
    """A pixel of the background counts as the first box's."""
    for name in ("instance", "semantic", "part"):
        planes[name][0, 0] = 1


def shifted(planes, content) -> None:
    """One point half a pixel beside its centre, in every plane that has it."""
    y, x = somewhere()
    seen = np.linalg.inv(K) @ (x + 0.5, y, 1) * float(planes["depth"][y, x])
    planes["position_camera"][y, x] = seen
    planes["position"][y, x] = (seen - CAMERA[:3, 3]) @ CAMERA[:3, :3]
    planes["distance"][y, x] = np.linalg.norm(seen)
    for name in ("object_coordinates", "flow_forward"):
        planes.pop(name)


def leaves(planes, content) -> None:
    planes["flow_forward"][0, 0] = -9
    planes["flow_forward_visible"][0, 0] = 1


def stands_still(planes, content) -> None:
    """The flow that the second box would have by the camera's motion alone."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    second = planes["instance"] == 2
    there = planes["position"].astype(float) @ LATER[:3, :3].T + LATER[:3, 3]
    flow = projected(there) - np.stack([columns, rows], axis=-1)
    planes["flow_forward"][second] = flow[second]
    planes["flow_forward_visible"][second] = 0


def moved_with_all(planes, content) -> None:
    """The pose of another time, in the world and before the camera, with its corners."""
    r = content["instances"][0]
    by = np.array([0.03, 0.03, 0.03])
    pose, seen = np.array(r["world_from_object"]), np.array(r["camera_from_object_cv"])
    pose[:3, 3] += by
    seen[:3, 3] += CAMERA[:3, :3] @ by
    corners = np.array(r["corners_camera"]) + CAMERA[:3, :3] @ by
    r.update(world_from_object=pose.tolist(), camera_from_object_cv=seen.tolist())
    r.update(corners_camera=corners.tolist(), corners_image=projected(corners).tolist())


def box_smaller(planes, content) -> None:
    r = content["instances"][0]
    r["bbox_visible"][0] += 1


DISPARITY = "disparity:right"
PLANE_FAULTS = {
    "beauty has nan": ("radiance", pixel("beauty", lambda v: v * np.nan)),
    "radiance below 0": ("radiance", pixel("beauty", lambda v: v - 3)),
    "depth along the ray": ("depth", plane("depth", lambda p: p["distance"], (DISPARITY,))),
    "depth in millimetres": ("depth", plane("depth", lambda p: 1e3 * p["depth"])),
    "depth 0 at the background": (
        "depth",
        plane("depth", lambda p: np.where(p["depth"] > 9, 0, p["depth"]), ("normal", DISPARITY)),
    ),
    "distance is depth": ("distance", plane("distance", lambda p: p["depth"])),
    "a position off": (
        "positions",
        pixel("position", lambda v: v + 0.01, ("flow_forward", "object_coordinates")),
    ),
    "a position between pixels": ("projection", shifted),
    "normal of length 2": ("normals", pixel("normal", lambda v: 2 * v)),
    "normal_camera of another": ("normals", pixel("normal_camera", lambda v: v[::-1])),
    "geometric normals turned away": (
        "normals",
        plane("geometric_normal", lambda p: -p["geometric_normal"]),
    ),
    "id of no row": (
        "instance",
        lambda planes, content: (
            (content["instances"].pop(), content["keypoints"].pop()) and planes.pop("semantic")
        ),
    ),
    "id at the background": ("instance", lent),
    "box of the outer pixels": ("masks", box_smaller),
    "class of another instance": ("semantic", pixel("semantic", lambda v: 2)),
    "no part": ("part", pixel("part", lambda v: 0)),
    "nocs by axis": ("nocs", plane("nocs", lambda p: p["object_coordinates"])),
    "poses of another time": ("object_points", moved_with_all),
    "flow at one pixel": ("flow", pixel("flow_forward", lambda v: -v - 2)),
    "flow upward": (
        "flow",
        plane("flow_forward", lambda p: p["flow_forward"] * (1, -1), ("flow_forward_visible",)),
    ),
    "flow without the object's motion": ("flow", stands_still),
    "visible outside the image": ("flow_visible", leaves),
    "disparity in other units": ("disparity", pixel(DISPARITY, lambda v: v * 1.5)),
}
