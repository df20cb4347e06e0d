"""Panels of the page: the scene's tree, its cameras, a first view, one object."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray
from ..errors import HeliographError
from ..image.notebook import kind_of
from ..scene.handles import Entity, Handle, Material
from .session import LAYERS, PLANES

if TYPE_CHECKING:
    from ..client.scene import Scene

_MOST_OBJECTS = 20_000  # of the tree; the page shows how many more there are
_MOST_READ = 5_000


def of_scene(scene: Scene, camera: str) -> dict[str, Any]:
    """Data that the page begins with. Ids are texts: JavaScript's numbers have 53 bits."""
    info = scene.describe(tree=True)
    objects = [
        [str(o.id), kind_of(o.id), o.name, str(o.parent), o.uses]
        for o in info.objects[:_MOST_OBJECTS]
    ]
    entities = [o for o in info.objects if kind_of(o.id) == "entity"]
    handles = [Entity(scene, o.name, o.id) for o in entities[:_MOST_READ]]
    rows = scene.read(handles, ["entity", "aabb"]) if handles else []
    cameras = [h.name for h, row in zip(handles, rows) if row[0].entity.HasField("camera")]
    box = _bounds_of([np.asarray(row[1]) for row, o in zip(rows, entities)
                      if row[1] is not None and not o.parent])  # fmt: skip
    return {
        "name": scene.name or "scene",
        "address": scene.client.address,
        "revision": info.scene.revision,
        "objects": objects,
        "more": max(0, len(info.objects) - _MOST_OBJECTS),
        "cameras": {name: looking_of(scene, name, box) for name in cameras if name},
        "bounds": box.tolist(),
        "camera": camera,
        "planes": PLANES,
        "layers": LAYERS,
    }


def _bounds_of(boxes: list[NdArray]) -> NdArray:
    """(2, 3): the box of all things but those much larger than most, as floors are."""
    boxes = [b for b in boxes if np.isfinite(b).all() and (b[1] > b[0]).any()]
    if not boxes:
        return np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    sizes = np.array([float(np.linalg.norm(b[1] - b[0])) for b in boxes])
    kept = [b for b, size in zip(boxes, sizes) if size <= 8 * float(np.quantile(sizes, 0.25))]
    return np.array([np.min([b[0] for b in kept], 0), np.max([b[1] for b in kept], 0)])


def looking_of(scene: Scene, name: str, box: NdArray) -> dict[str, Any]:
    """Eye, target and field of view (degrees, of the height) of the free camera that replaces one
    of the scene's: its target is before it, as far away as the middle of the box."""
    entity = scene[name]
    pose, lens = np.asarray(entity.world_transform, "f8"), entity.camera
    eye, forward = pose[:3, 3], -pose[:3, 2] / np.linalg.norm(pose[:3, 2])
    away = float(np.dot(np.asarray(box, "f8").mean(axis=0) - eye, forward))
    away = max(away, 0.05 * float(np.linalg.norm(box[1] - box[0])), 1e-3)
    fov = 50.0
    if lens.fy and lens.fy > 0:
        fov = min(150.0, math.degrees(2 * math.atan(0.5 * lens.height / lens.fy)))
    return {"eye": eye.tolist(), "target": (eye + away * forward).tolist(), "fov": fov}


def of_object(scene: Scene, id: int) -> dict[str, Any]:
    """Rows of one object: its kind, its name, and one line per property."""
    handle: Handle = scene.handle(id)
    out: dict[str, Any] = {"id": str(id), "kind": handle.kind, "rows": []}
    rows: list[tuple[str, str]] = out["rows"]
    if isinstance(handle, Entity):
        pose, box = scene.read([handle], ["world_pose", "aabb"])[0]
        rows.append(("position", _numbers(np.asarray(pose)[:3, 3])))
        if box is not None and np.isfinite(box).all():
            out["aabb"] = np.asarray(box, "f8").tolist()
            rows.append(("size", _numbers(np.asarray(box)[1] - np.asarray(box)[0]) + " m"))
        for field in ("mesh", "material", "parent"):
            found = getattr(handle, field)
            if found is not None:
                rows.append((field, _name_of(scene, found)))
        rows.append(("visible", "yes" if handle.visible else "no"))
    elif isinstance(handle, Material):
        for name, value in handle.parameters.items():
            rows.append((name.replace("_", " "), _numbers(np.atleast_1d(value))))
    return out


def _name_of(scene: Scene, handle: Handle) -> str:
    if handle.name:
        return handle.name
    try:
        names = {o.id: o.name for o in scene.describe(tree=True).objects}
    except HeliographError:
        return hex(handle.id)
    return names.get(handle.id, "") or hex(handle.id)


def _numbers(values: Any) -> str:
    return "  ".join(f"{float(v):.4g}" for v in values)
