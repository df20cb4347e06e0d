"""View of the scene: a camera at a size, its poses, and when its shutter is open."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import heliograph as hg

from .entities import entity
from .placement import nearest_rotation
from .settings import current


class View(NamedTuple):
    """poses: (4, 4) nested tuples, world from camera, of the previous frame and of now."""

    camera: hg.Camera
    poses: tuple[Any, Any]


def view_of(found: entity | None, size: tuple[int, int], shutter: tuple[float, ...]) -> View:
    """View of a camera entity. RuntimeError names a missing component."""
    if found is None:
        raise RuntimeError("there is no camera: call nvisii.set_camera_entity(entity) first")
    if found._camera is None or found._transform is None:
        raise RuntimeError(f'entity "{found._name}" needs a transform and a camera to see')
    if min(size) < 1:
        raise RuntimeError(f"width and height must be above 0, not {size[0]} and {size[1]}")
    shift = (0.5 - sum(current.x_interval) / 2, sum(current.y_interval) / 2 - 0.5)
    poses = tuple(_rigid(found._transform._world(previous)) for previous in (True, False))
    return View(found._camera._sent(size, shift, shutter), (poses[0], poses[1]))


def _rigid(world: Any) -> Any:
    """Pose (4, 4) without its scale. RuntimeError if it mirrors."""
    out = np.eye(4)
    out[:3, :3] = nearest_rotation(world[:3, :3])
    if np.linalg.det(out[:3, :3]) < 0:
        raise RuntimeError("the camera's transform mirrors: a scale is below 0")
    out[:3, 3] = world[:3, 3]
    return tuple(map(tuple, out.tolist()))
