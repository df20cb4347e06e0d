"""Frames made by hand, whose labels are known by arithmetic."""

import heliograph as hg
import numpy as np
from heliograph._wire._proto import render_pb2
from heliograph._wire.arrays import describe, inline

K = np.array([[100.0, 0, 40.0], [0, 120.0, 25.0], [0, 0, 1]])  # fx != fy, off the centre
SIZE = (64, 48)


def frame(planes=(), columns=(), *, k=K, camera_from_world=None, categories=None):
    """planes: {name: array}; columns: {name: array or list of str}."""
    world = np.eye(4) if camera_from_world is None else camera_from_world
    header = render_pb2.FrameHeader(
        camera="cam", width=SIZE[0], height=SIZE[1], k=inline(k), camera_from_world_cv=inline(world)
    )
    arrays = []
    for name, array in dict(planes).items():
        header.planes.add(name=name, channels=1 if array.ndim == 2 else array.shape[-1])
        arrays.append(array)
    for name, values in dict(columns).items():
        column = header.labels.add(name=name)
        if isinstance(values, list):
            column.strings.extend(values)
        else:
            message = describe(values)
            column.dtype, column.data = message.dtype, values.tobytes()
            column.shape.extend(values.shape)
    for number, name in (categories or {}).items():
        header.categories.add(id=number, name=name)
    return hg.Frame(header, arrays)


def rows(*instances):
    """Label columns of one row each, {column: value}, over sensible defaults."""
    table = []
    for i, given in enumerate(instances):
        row = {
            "label": np.uint32(i + 1),
            "name": f"thing/{i}",
            "category": np.uint32(1),
            "rigid": np.uint8(1),
            "world_from_object": np.eye(4),
            "camera_from_object_cv": np.eye(4),
            "scale": np.ones(3, "f4"),
            "box_center": np.zeros(3, "f4"),
            "box_half_extents": np.ones(3, "f4"),
            "corners_image": np.zeros((8, 2), "f4"),
            "visible": np.uint32(4),
            "inside": np.uint32(8),
            "canvas": np.uint32(10),
            "visibility": np.float32(0.4),
            "occlusion": np.float32(0.5),
            "truncation": np.float32(0.2),
            "bbox_amodal": np.array([2, 1, 6, 5], "i4"),
            "bbox_amodal_canvas": np.array([-3, 1, 6, 5], "i4"),
        }
        table.append({**row, **given})
    out = {name: [row[name] for row in table] for name in table[0]}
    return {n: v if isinstance(v[0], str) else np.stack(v) for n, v in out.items()}
