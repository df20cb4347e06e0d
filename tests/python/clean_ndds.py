"""A clean NDDS data set: cuboids projected in numpy; and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from shapes_seen import HEIGHT, WIDTH, K, edit_json, picture, placed, quaternion_xyzw, turned
from shapes_seen import write_json as put

# Front left bottom, front right bottom, front right top, front left top; the same at the rear, by
# DOPE's sketch with x forward, y left, z up.
ORDER = [(1, 1, -1), (1, -1, -1), (1, -1, 1), (1, 1, 1)]
ORDER += [(-1, y, z) for _, y, z in ORDER]
NVISII = [(1, -1, 1), (1, 1, 1), (1, 1, -1), (1, -1, -1)]
NVISII += [(-1, y, z) for _, y, z in NVISII]
HALF = np.array([0.12, 0.07, 0.05])
CENTER = np.array([0.0, 0.01, 0.02])


def cuboid(order) -> np.ndarray:
    corners = np.array(order) * HALF + CENTER
    return np.concatenate([corners, corners.mean(0, keepdims=True)])


def projected(local: np.ndarray, rotation: np.ndarray, t: np.ndarray) -> list[list[float]]:
    pixels = (local @ rotation.T + t) @ K.T
    return (pixels[:, :2] / pixels[:, 2:]).tolist()


def make(root: Path) -> None:
    view = np.eye(4)
    view[:3, :3] = turned((1, 0, 0), 2.0)
    view[:3, 3] = 0.1, 0.2, 0.3
    for image in range(2):
        picture(root / f"{image:06d}.png", image)
        objects = []
        for i, (rotation, t) in enumerate(placed(image)):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotation, t
            local = cuboid(ORDER)
            row = {"class": "box", "name": f"box{i}", "visibility": 1.0 - 0.4 * i}
            row |= {"location": t.tolist(), "quaternion_xyzw": quaternion_xyzw(rotation)}
            row["projected_cuboid"] = projected(local, rotation, t)
            if i == 0:  # local_cuboid and the world's matrix are optional
                row["local_cuboid"] = local.tolist()
                row["local_to_world_matrix"] = (np.linalg.inv(view) @ pose).tolist()
            objects.append(row)
        inner = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        camera = {"width": WIDTH, "height": HEIGHT, "intrinsics": inner}
        camera["camera_view_matrix"] = view.tolist()
        put(root / f"{image:06d}.json", {"camera_data": camera, "objects": objects})


def row(change, index: int = 0):
    return lambda root: edit_json(
        root / "000000.json", lambda c: change(c["objects"][index]) and None
    )


def camera(change):
    return lambda root: edit_json(root / "000000.json", lambda c: change(c["camera_data"]) and None)


def seen_as(order, index: int):
    """The corners in another order."""

    def change(entry) -> None:
        rotation, t = placed(0)[index]
        entry["projected_cuboid"] = projected(cuboid(order), rotation, t)

    return row(change, index)


def millimetres(entry) -> None:
    entry["location"] = [1e3 * v for v in entry["location"]]


FAULTS = {
    "object without class": ("ndds.format", row(lambda r: r.pop("class"))),
    "no camera_data": (
        "ndds.format",
        lambda root: edit_json(root / "000001.json", lambda c: c.pop("camera_data") and None),
    ),
    "width and height swapped": (
        "ndds.image_files",
        camera(lambda c: c.update(width=HEIGHT, height=WIDTH)),
    ),
    "picture removed": ("ndds.image_files", lambda root: (root / "000001.png").unlink()),
    "picture without JSON": ("ndds.counts", lambda root: picture(root / "000002.png", 2)),
    "view matrix transposed": (
        "ndds.camera",
        camera(lambda c: c.update(camera_view_matrix=np.array(c["camera_view_matrix"]).T.tolist())),
    ),
    "no focal length": ("ndds.camera", camera(lambda c: c["intrinsics"].update(fx=0))),
    "quaternion of length 2": (
        "ndds.quaternion",
        row(lambda r: r.update(quaternion_xyzw=[2 * v for v in r["quaternion_xyzw"]])),
    ),
    "quaternion wxyz": (
        "ndds.reprojection",
        row(lambda r: r.update(quaternion_xyzw=np.roll(r["quaternion_xyzw"], 1).tolist()), 1),
    ),
    "visibility in percent": ("ndds.visibility", row(lambda r: r.update(visibility=60))),
    "camera looks along -z": (
        "ndds.behind",
        row(lambda r: r.update(location=[-v for v in r["location"]])),
    ),
    "cuboid of eight": ("ndds.cuboid", row(lambda r: r["projected_cuboid"].pop())),
    "ninth point is no centroid": (
        "ndds.cuboid",
        row(lambda r: r["projected_cuboid"].__setitem__(8, [3.0, 3.0])),
    ),
    "NViSII's order": ("ndds.cuboid_order", seen_as(NVISII, 1)),
    "local_cuboid in NViSII's order": (
        "ndds.cuboid_order",
        row(lambda r: r.update(local_cuboid=cuboid(NVISII).tolist())),
    ),
    "two corners swapped": ("ndds.reprojection", seen_as([ORDER[1], ORDER[0], *ORDER[2:]], 1)),
    "world matrix of another object": (
        "ndds.poses",
        row(lambda r: r["local_to_world_matrix"][0].__setitem__(3, 0.5)),
    ),
    "location in millimetres": ("ndds.units", row(millimetres)),
    "local_cuboid in millimetres": (
        "ndds.units",
        row(lambda r: r.update(local_cuboid=(1e3 * cuboid(ORDER)).tolist())),
    ),
    "location off": (
        "ndds.reprojection",
        row(lambda r: r.update(location=[r["location"][0] + 0.7, *r["location"][1:]]), 1),
    ),
    "cuboid moved by 5 px": (
        "ndds.reprojection",
        row(lambda r: r["projected_cuboid"].__setitem__(2, [9.0, 20.0])),
    ),
}
