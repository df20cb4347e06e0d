"""Settings that belong to no component: the dome, clamps, depths, sampling, the denoiser."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .checks import not_below_zero, number, stops, whole
from .component import Component, check
from .glm.quaternions import quat, quat_of, rotation_of
from .glm.vectors import Numbers, floats
from .textures import texture

__all__ = [
    "clear_dome_light_texture",
    "configure_denoiser",
    "disable_denoiser",
    "disable_dome_light_sampling",
    "enable_denoiser",
    "enable_dome_light_sampling",
    "sample_pixel_area",
    "sample_time_interval",
    "set_direct_lighting_clamp",
    "set_dome_light_color",
    "set_dome_light_exposure",
    "set_dome_light_intensity",
    "set_dome_light_rotation",
    "set_dome_light_sky",
    "set_dome_light_texture",
    "set_indirect_lighting_clamp",
    "set_light_sample_count",
    "set_max_bounce_depth",
]

_SKY_LUMINANCE = 0.4  # of the default sky, its mean, in the units of a dome's colour


@dataclass
class Dome:
    """The light from infinitely far."""

    intensity: float = 1.0
    exposure: float = 0.0
    color: tuple[float, ...] | None = None
    image: texture | None = None
    sky: tuple[Any, ...] = ((0.0, 0.0, 10.0), (0.5, 0.5, 0.5), 1.0, 1.0)
    rotation: quat = field(default_factory=quat)

    def strength(self) -> float:
        return float(self.intensity * 2.0**self.exposure)

    def turn(self) -> Any:
        """(3, 3) world from dome."""
        return rotation_of(self.rotation)


@dataclass
class Settings:
    """Settings of the process, at first its defaults; clear_all() and deinitialize() keep them."""

    dome: Dome = field(default_factory=Dome)
    dome_changed: bool = True
    direct_clamp: float = 0.0
    indirect_clamp: float = 0.0
    depths: tuple[int, ...] = (2, 8, 8, 12, 2)
    x_interval: tuple[float, ...] = (0.0, 1.0)
    y_interval: tuple[float, ...] = (0.0, 1.0)
    time_interval: tuple[float, ...] = (0.0, 1.0)
    denoise: bool = False
    light_samples: int = 1


current = Settings()


class _DomeUser(Component):
    """User of the dome's texture: learns when the texture is changed or removed."""

    def __init__(self) -> None:
        self._name, self._id, self._alive = "", 0, True

    def mark_dirty(self) -> None:
        current.dome_changed = True

    def _used(self) -> list[Component]:
        return [] if current.dome.image is None else [current.dome.image]

    def _lose(self, used: Component) -> None:
        current.dome.image, current.dome_changed = None, True


_user = _DomeUser()


def _put_dome(**values: Any) -> None:
    old = current.dome.image
    for name, value in values.items():
        setattr(current.dome, name, value)
    current.dome_changed = True
    if old is not current.dome.image:
        _user._swap(old, current.dome.image)


def set_dome_light_intensity(intensity: float) -> None:
    """A factor of the dome's light, not below 0."""
    _put_dome(intensity=max(0.0, number("intensity", intensity)))


def set_dome_light_exposure(exposure: float) -> None:
    """Stops, -64 to 64: the dome's light is multiplied by 2^exposure, also where it is seen."""
    _put_dome(exposure=stops("exposure", exposure))


def set_dome_light_color(color: Numbers) -> None:
    """A uniform dome; each channel is clamped to [0, 1]. It replaces a texture."""
    clamped = tuple(min(max(c, 0.0), 1.0) for c in floats(color, 3, "color"))
    _put_dome(color=clamped, image=None)


def set_dome_light_sky(
    sun_position: Numbers,
    sky_tint: Numbers = (0.5, 0.5, 0.5),
    atmosphere_thickness: float = 1.0,
    saturation: float = 1.0,
) -> None:
    """A clear sky without the sun's disc. sun_position: the direction to the sun, +Z up."""
    sun = floats(sun_position, 3, "sun_position")
    if not any(sun):
        raise RuntimeError("sun_position: has no direction")
    tint = floats(sky_tint, 3, "sky_tint")
    thickness = number("atmosphere_thickness", atmosphere_thickness)
    sky = (sun, tint, thickness, number("saturation", saturation))
    _put_dome(sky=sky, color=None, image=None)


def set_dome_light_texture(texture: texture, enable_cdf: bool = False) -> None:
    """A lat-long picture. It is always sampled by its brightness."""
    check("texture", _texture, texture)
    _put_dome(image=texture, color=None)


def clear_dome_light_texture() -> None:
    """The sky again."""
    _put_dome(image=None)


def set_dome_light_rotation(rotation: Numbers) -> None:
    _put_dome(rotation=quat_of(rotation, "rotation"))


def enable_dome_light_sampling() -> None:
    """The dome is always sampled."""


def disable_dome_light_sampling() -> None:
    """Changes nothing but noise in nvisii; here the dome is sampled all the same."""


def set_direct_lighting_clamp(clamp: float) -> None:
    """The largest radiance of one contribution of direct light; 0: any."""
    current.direct_clamp = not_below_zero("clamp", clamp)


def set_indirect_lighting_clamp(clamp: float) -> None:
    """The largest radiance of one contribution of indirect light; 0: any."""
    current.indirect_clamp = not_below_zero("clamp", clamp)


def set_max_bounce_depth(
    diffuse_depth: int = 2,
    glossy_depth: int = 8,
    transparency_depth: int = 8,
    transmission_depth: int = 12,
    volume_depth: int = 2,
) -> None:
    """Paths have two edges more than the largest of these."""
    given = dict(locals())
    current.depths = tuple(whole(name, depth, 0) for name, depth in given.items())


def set_light_sample_count(count: int) -> None:
    """1 to 10; kept. One light is sampled at each vertex."""
    if not 1 <= whole("count", count) <= 10:
        raise RuntimeError(f"count: {count} is not between 1 and 10")
    current.light_samples = int(count)


def sample_pixel_area(
    x_sample_interval: Numbers = (0.0, 1.0), y_sample_interval: Numbers = (0.0, 1.0)
) -> None:
    """Sets the area of a pixel that samples cover; (.5, .5): its centre. Only the middle of each
    interval counts."""
    current.x_interval = _interval("x_sample_interval", x_sample_interval)
    current.y_interval = _interval("y_sample_interval", y_sample_interval)


def sample_time_interval(time_sample_interval: Numbers = (0.0, 1.0)) -> None:
    """Sets when the shutter is open; 0: at the previous poses, 1: at the current ones."""
    current.time_interval = _interval("time_sample_interval", time_sample_interval)


def enable_denoiser() -> None:
    current.denoise = True


def disable_denoiser() -> None:
    current.denoise = False


def configure_denoiser(
    use_albedo_guide: bool = True,
    use_normal_guide: bool = True,
    use_kernel_prediction: bool = True,
) -> None:
    """The denoiser always has both guides."""
    if use_normal_guide and not use_albedo_guide:
        raise RuntimeError("configure_denoiser: the normal guide needs the albedo guide")


def _interval(name: str, value: Numbers) -> tuple[float, ...]:
    low, high = floats(value, 2, name)
    if not 0 <= low <= high <= 1:
        raise RuntimeError(f"{name}: needs 0 <= begin <= end <= 1, not ({low}, {high})")
    return low, high


def sky_image(sky: tuple[Any, ...]) -> Any:
    """(H, W, 3) float32 lat-long: the air's colours, scaled so that the default's mean is that of a
    grey dome; below the horizon it is mirrored."""
    from heliograph.values.sky import sky as clear_sky

    (x, y, z), tint, thickness, saturation = sky
    elevation = math.atan2(z, math.hypot(x, y))
    made = clear_sky(elevation, math.atan2(y, x), aerosol=max(0.0, min(thickness, 20.0)))
    radiance = made.radiance.astype("f8") / _CLEAR_MEAN * _SKY_LUMINANCE
    radiance *= np.array(tint) / 0.5
    half = len(radiance) // 2
    radiance[half:] = radiance[:half][::-1]
    luminance = radiance @ (0.2126, 0.7152, 0.0722)
    radiance = luminance[..., None] + (radiance - luminance[..., None]) * saturation
    return np.maximum(radiance, 0).astype("f4")


_CLEAR_MEAN = 6.17  # W sr^-1 m^-2: mean luminance of the upper half, the sun at its zenith
_texture = texture
