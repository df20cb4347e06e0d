"""The bundled studio: a dome of soft boxes, and a floor. Used by edit.sample_studio()."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._wire.arrays import NdArray

if TYPE_CHECKING:
    from ..client.edit import Edits
    from .handles import Entity

# Soft boxes: azimuth, elevation, half width, half height (degrees), radiance (r, g, b).
_BOXES = (
    (35.0, 48.0, 24.0, 18.0, (13.0, 12.4, 11.6)),  # key
    (-70.0, 30.0, 14.0, 26.0, (3.6, 3.9, 4.4)),  # fill
    (165.0, 35.0, 9.0, 30.0, (7.0, 7.2, 7.6)),  # rim
    (-140.0, 62.0, 16.0, 10.0, (5.0, 5.0, 5.0)),  # top
)
_EDGE_DEGREES = 2.5


def dome(width: int = 512) -> NdArray:
    """(width / 2, width, 3) float16 radiance, lat-long, row 0 at +Z: a room with soft boxes."""
    height = width // 2
    elevation = 90.0 - (np.arange(height)[:, None] + 0.5) * (180.0 / height)
    azimuth = 180.0 - (np.arange(width)[None, :] + 0.5) * (360.0 / width)
    up = np.sin(np.radians(elevation))
    room = np.where(up > 0, 0.42 + 0.30 * up, 0.42 - 0.26 * np.minimum(1, -3 * up))
    image = room[..., None] * np.array([1.0, 0.995, 0.985])
    image = np.broadcast_to(image, (height, width, 3)).copy()
    for center, middle, half_width, half_height, radiance in _BOXES:
        across = np.abs((azimuth - center + 180.0) % 360.0 - 180.0)
        across = across * np.cos(np.radians(elevation))
        shape = _edge(half_width - across) * _edge(half_height - np.abs(elevation - middle))
        image += shape[..., None] * np.array(radiance)
    return image.astype("<f2")


def _edge(inside: NdArray) -> NdArray:
    """0 outside, 1 inside, smooth over the edge's width."""
    t = np.clip(inside / _EDGE_DEGREES + 0.5, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def add_floor(edit: Edits, size: float, center: tuple[float, float, float] = (0, 0, 0)) -> Entity:
    """A square floor called "floor"; it has no label."""
    from ..values import shapes
    from ..values.pose import Pose

    mesh = edit.mesh("floor/mesh", **shapes.plane(size))
    material = edit.material("floor/material", base_color=0.42, roughness=0.55)
    return edit.entity("floor", mesh=mesh, material=material, transform=Pose(center), label=0)
