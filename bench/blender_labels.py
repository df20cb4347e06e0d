"""Labels of a picture that Blender rendered, of its passes and of numbers of the scene: what a
script that makes a data set with Blender does after each picture, by numpy alone and all at once.
Used by datasets_blender.py.

Of each object: its pose in the camera's frame (x right, y down, z forward), the corners of its box
there and in the picture, the pixels and the box of what is seen of it, and of its silhouette, as if
nothing hid it (N, in pixels, inside the picture).
"""

import json

import numpy as np
import OpenEXR

NEAR = 1e-3  # metres, before which triangles are left out
CHUNK = 64  # objects whose silhouettes are drawn at once


def boxes_of(owners, x, y, count):
    """(count,) pixels and (count, 4) half-open boxes x0, y0, x1, y1 of pixels that objects own; 0
    where they have none."""
    pixels = np.bincount(owners, minlength=count)
    order = np.argsort(owners, kind="stable")
    boxes = np.zeros((count, 4), int)
    seen = np.flatnonzero(pixels)
    starts = (np.cumsum(pixels) - pixels)[seen]
    if len(seen):
        for column, values in ((0, x[order]), (1, y[order])):
            boxes[seen, column] = np.minimum.reduceat(values, starts)
            boxes[seen, column + 2] = np.maximum.reduceat(values, starts) + 1
    return pixels, boxes


def spans(low, high, size):
    """First pixel and number of pixels whose centres lie in [low, high], inside the picture."""
    first = np.clip(np.ceil(low - 0.5), 0, size).astype(np.int64)
    last = np.clip(np.floor(high - 0.5), -1, size - 1).astype(np.int64)
    return first, np.maximum(last - first + 1, 0)


def covered(corners, size):
    """Pairs of a triangle and a pixel whose centre lies inside it: indices of triangles, and x and
    y of pixels.

    corners: (M, 3, 2) float32 pixels."""
    x0, width = spans(corners[..., 0].min(1), corners[..., 0].max(1), size[0])
    y0, height = spans(corners[..., 1].min(1), corners[..., 1].max(1), size[1])
    area = width * height
    met = np.flatnonzero(area)
    x0, y0, width, area, corners = x0[met], y0[met], width[met], area[met], corners[met]
    which = np.repeat(np.arange(len(met)), area)
    place = np.arange(len(which)) - np.repeat(np.cumsum(area) - area, area)
    x, y = x0[which] + place % width[which], y0[which] + place // width[which]
    centre = np.stack([x, y], 1).astype(np.float32) + np.float32(0.5)
    sides = []
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        along, away = (b - a)[which], centre - a[which]
        sides.append(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
    inside = (np.minimum.reduce(sides) >= 0) | (np.maximum.reduce(sides) <= 0)
    return met[which[inside]], x[inside], y[inside]


class Labels:
    """The labels of the pictures of a dump."""

    def __init__(self, data):
        self.size = [int(n) for n in data["size"]]
        self.mesh_of = data["mesh_of"]
        count = int(self.mesh_of.max()) + 1
        self.positions = [data[f"positions{i}"].astype(np.float64) for i in range(count)]
        self.indices = [data[f"indices{i}"].astype(np.int64) for i in range(count)]
        bounds = np.array([(p.min(0), p.max(0)) for p in self.positions])
        signs = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
        self.corners = np.stack([b[signs, np.arange(3)] for b in bounds])
        focal = 0.5 * self.size[0] / np.tan(0.5 * float(data["fov"]))
        self.k = np.array(
            [[focal, 0, 0.5 * self.size[0]], [0, focal, 0.5 * self.size[1]], [0, 0, 1]]
        )

    def _project(self, points):
        image = points @ self.k.T
        return image[..., :2] / image[..., 2:]

    def _silhouettes(self, poses):
        """(N,) pixels and (N, 4) boxes of the objects alone."""
        pixels, boxes = [], []
        width, height = self.size
        for begin in range(0, len(poses), CHUNK):
            owners, corners = [], []
            for i in range(begin, min(begin + CHUNK, len(poses))):
                mesh = self.mesh_of[i]
                points = self.positions[mesh] @ poses[i, :3, :3].T + poses[i, :3, 3]
                before = points[:, 2] > NEAR
                points[:, 2] = np.where(before, points[:, 2], 1)
                triangles = self.indices[mesh]
                if not before.all():
                    triangles = triangles[before[triangles].all(1)]
                corners.append(self._project(points).astype(np.float32)[triangles])
                owners.append(np.full(len(triangles), i - begin))
            which, x, y = covered(np.concatenate(corners), self.size)
            count = len(owners)
            met = np.zeros(count * width * height, bool)
            met[(np.concatenate(owners)[which] * height + y) * width + x] = True
            at = np.flatnonzero(met)
            owner, place = at // (width * height), at % (width * height)
            chunk = boxes_of(owner, place % width, place // width, count)
            pixels.append(chunk[0])
            boxes.append(chunk[1])
        return np.concatenate(pixels), np.concatenate(boxes)

    def write(self, picture, draw, path):
        """Writes the labels of a picture's multilayer EXR and of the draw that it shows, as
        JSON."""
        with OpenEXR.File(str(picture), separate_channels=True) as file:
            passes = {name: c for part in file.parts for name, c in part.channels.items()}
            index = passes["ViewLayer.Object Index.X"].pixels.astype(np.int64)
        world_from_camera = np.array(draw["view"])
        camera_from_world = np.diag([1, -1, -1, 1]) @ np.linalg.inv(world_from_camera)
        poses = camera_from_world @ np.array(draw["poses"])
        corners = (
            np.einsum("nij,nkj->nki", poses[:, :3, :3], self.corners[self.mesh_of])
            + poses[:, None, :3, 3]
        )
        y, x = np.nonzero(index)
        seen = boxes_of(index[y, x] - 1, x, y, len(poses))
        alone = self._silhouettes(poses)
        columns = {
            "world_from_object": np.array(draw["poses"]),
            "camera_from_object_cv": poses,
            "corners_camera": corners,
            "corners_image": self._project(corners),
            "pixels": seen[0],
            "box": seen[1],
            "amodal_pixels": alone[0],
            "amodal_box": alone[1],
        }
        rows = [
            dict(zip(columns, row, strict=True))
            for row in zip(*(c.tolist() for c in columns.values()), strict=True)
        ]
        out = {"K": self.k.tolist(), "camera_from_world_cv": camera_from_world.tolist()}
        path.write_text(json.dumps({**out, "instances": rows}))
