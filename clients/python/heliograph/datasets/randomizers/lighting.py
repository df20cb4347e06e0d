"""random_dome, random_lights: where light comes from."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...values.lights import Light
from ...values.pose import Pose
from . import ranges
from .pictures import CACHE_BYTES, Pictures
from .ranges import HsvColor, LogUniform, Range

if TYPE_CHECKING:
    from ..draw import Draw

_FOLDER = Path(__file__).parent / "domes"
_ENDINGS = (".exr", ".hdr")
_INTENSITY, _POWER = LogUniform(0.5, 2.0), LogUniform(30.0, 300.0)
_TINT = HsvColor(saturation=(0.0, 0.5), value=1.0)


def bundled_domes() -> list[Path]:
    """The lat-long pictures that come with the package, CC0: forest, interior and studio by Greg
    Zaal (HDRI Haven), and softboxes, which is that of edit.sample_studio()."""
    return sorted(_FOLDER.glob("*.exr"))


class RandomDome:
    """Lights the scene by one of several lat-long pictures, turned about +Z.

    images: files, arrays (H, W, 3), or a folder, for its .exr and .hdr files; default:
    bundled_domes(). rotation: radians. intensity: a factor. camera_visible: True if the camera sees
    it. cache_bytes: of pictures that stay decoded; the others are decoded again.
    """

    def __init__(
        self,
        images: Any = None,
        *,
        rotation: Range = (0.0, 2 * math.pi),
        intensity: Range = _INTENSITY,
        camera_visible: bool = True,
        cache_bytes: int = CACHE_BYTES,
    ) -> None:
        listed = bundled_domes() if images is None else images
        self.images = Pictures(listed, _ENDINGS, cache_bytes)
        self.rotation = ranges.checked_range(rotation, "rotation")
        self.intensity = ranges.checked_range(intensity, "intensity", 0)
        self.camera_visible = bool(camera_visible)

    def __call__(self, draw: Draw) -> None:
        choice = int(draw.rng.integers(len(self.images)))
        draw.edit.dome(
            self.images.radiance(draw.scene.client, choice),
            intensity=ranges.number(draw.rng, self.intensity),
            rotation=ranges.number(draw.rng, self.rotation),
            camera_visible=self.camera_visible,
        )


class RandomLights:
    """Adds spherical lights in the half space behind a camera, where it does not see them.

    count: how many, a whole number or (low, high), both of which occur. camera: default the draw's
    first. distance: metres from the camera. radius: of a sphere, metres. power: W over all
    directions. color: linear, as of RandomMaterials; temperature: kelvin, which multiplies it, 0
    for none. angle: radians; the directions from the camera are uniform within that angle of
    straight back. Their names are "random/light/0", "random/light/1" ...
    """

    def __init__(
        self,
        count: Any = (2, 6),
        *,
        camera: Any = None,
        distance: Range = (1.0, 4.0),
        radius: Range = (0.05, 0.5),
        power: Range = _POWER,
        color: Any = _TINT,
        temperature: Range = (2500.0, 9000.0),
        angle: float = 1.4,
    ) -> None:
        self.count, self.camera = ranges.checked_count(count, "count"), camera
        self.distance = ranges.checked_range(distance, "distance", 0)
        self.radius = ranges.checked_range(radius, "radius", 1e-6)
        self.power = ranges.checked_range(power, "power", 0)
        self.color = ranges.checked_color(color, "color")
        self.temperature = ranges.checked_range(temperature, "temperature", 0)
        self.angle = ranges.checked_number(angle, "angle", 0, math.pi)

    def __call__(self, draw: Draw) -> None:
        rng = draw.rng
        camera = draw.pose(draw.camera if self.camera is None else self.camera)
        backward = camera[:3, 2] / np.linalg.norm(camera[:3, 2])  # a camera looks along -Z
        elevation = (math.pi / 2 - self.angle, math.pi / 2)
        for _ in range(ranges.whole(rng, self.count)):
            radius, distance = ranges.number(rng, self.radius), ranges.number(rng, self.distance)
            way = ranges.turn_onto(backward) @ ranges.direction(rng, elevation)
            light = Light(
                shape="sphere",
                radius=radius,
                power=ranges.number(rng, self.power),
                color=tuple(ranges.color(rng, self.color)),
                temperature=ranges.number(rng, self.temperature),
            )
            pose = Pose(camera[:3, 3] + (distance + radius) * way)
            draw.edit.entity(draw.fresh("random/light"), light=light, transform=pose, label=0)
