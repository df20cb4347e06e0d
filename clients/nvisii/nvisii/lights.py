"""nvisii.light: light that an entity's mesh gives off, or a small lamp where it has no mesh."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import heliograph as hg

from .checks import not_below_zero, number, stops
from .component import Component
from .glm.vectors import Numbers, floats, vec3
from .textures import texture

_LAMP_RADIUS = 0.01  # metres, of a light without a mesh


class light(Component):
    """Colour, intensity and exposure. Intensity 1 of a mesh is pi watts a channel, whatever its
    area; with use_surface_area(True) it is the radiance, W sr^-1 m^-2; of an entity without a mesh
    it is the intensity in all directions, W sr^-1."""

    _missing_raises = True

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._color: tuple[float, ...] = (1.0, 1.0, 1.0)
        self._texture: texture | None = None
        self._intensity = 1.0
        self._exposure = 0.0
        self._falloff = 2.0
        self._by_area = False

    @classmethod
    def create(cls, name: str) -> light:
        """White, intensity 1."""
        return cls(name)

    @classmethod
    def create_from_temperature(cls, name: str, kelvin: float, intensity: float) -> light:
        """Makes a light with the colour of a black body. kelvin: its temperature."""
        color, strength = planckian(kelvin), not_below_zero("intensity", intensity)
        made = cls(name)
        made._color, made._intensity = color, strength
        return made

    @classmethod
    def create_from_rgb(cls, name: str, color: Numbers, intensity: float) -> light:
        """Makes a light with a linear RGB colour."""
        checked, strength = _color_of(color), not_below_zero("intensity", intensity)
        made = cls(name)
        made._color, made._intensity = checked, strength
        return made

    def set_color(self, color: Numbers) -> None:
        """A linear colour; it replaces a texture."""
        self._color = _color_of(color)
        self.clear_color_texture()

    def get_color(self) -> Any:
        return vec3(*self._color)

    def set_color_texture(self, texture: texture) -> None:
        """The colour of each point, by texture coordinates."""
        self._use("_texture", _texture, texture)

    def clear_color_texture(self) -> None:
        self._use("_texture", _texture, None)

    def set_temperature(self, kelvin: float) -> None:
        """The colour of a black body, its largest channel 1."""
        self.set_color(planckian(kelvin))

    def set_intensity(self, intensity: float) -> None:
        self._intensity = not_below_zero("intensity", intensity)
        self.mark_dirty()

    def get_intensity(self) -> float:
        return self._intensity

    def set_exposure(self, exposure: float) -> None:
        """Stops: the intensity is multiplied by 2^exposure."""
        self._exposure = stops("exposure", exposure)
        self.mark_dirty()

    def get_exposure(self) -> float:
        return self._exposure

    def set_falloff(self, falloff: float) -> None:
        """Kept; light falls off with the square of the distance, as it does."""
        self._falloff = number("falloff", falloff)

    def get_falloff(self) -> float:
        return self._falloff

    def use_surface_area(self, use: bool) -> None:
        """True: `intensity` is a radiance, so that a larger mesh gives off more light."""
        self._by_area = bool(use)
        self.mark_dirty()

    def _used(self) -> list[Component]:
        return [] if self._texture is None else [self._texture]

    def _lose(self, used: Component) -> None:
        self._texture = None
        self.mark_dirty()

    def _release(self) -> None:
        self.clear_color_texture()

    def _sent(self, has_mesh: bool, image: Any) -> hg.Light:
        """Light as the daemon gets it. image: handle of the texture there, or None."""
        given: dict[str, Any] = {"exposure": self._exposure, "texture": image}
        given["color"] = 1.0 if image is not None else self._color
        if not has_mesh:
            return hg.Light(intensity=self._intensity, shape="sphere", radius=_LAMP_RADIUS, **given)
        if self._by_area:
            return hg.Light(radiance=self._intensity, **given)
        return hg.Light(power=math.pi * self._intensity, **given)


def _color_of(given: Numbers) -> tuple[float, ...]:
    color = floats(given, 3, "color")
    if min(color) < 0:
        raise RuntimeError(f"color: {color} has a channel below 0")
    return color


def planckian(kelvin: float) -> tuple[float, ...]:
    """Linear Rec.709 of a black body, its largest channel 1 and none below 0. Planck 1901; colour
    matching functions after Wyman, Sloan and Shirley 2013."""
    if not 500 <= number("kelvin", kelvin) <= 100000:
        raise RuntimeError(f"kelvin: {kelvin} is outside [500, 100000]")
    nm = np.arange(380.0, 781.0, 5.0)
    radiance = nm**-5 / np.expm1(1.438777e7 / (nm * float(kelvin)))

    def lobe(mean: float, low: float, high: float) -> Any:
        return np.exp(-0.5 * ((nm - mean) * np.where(nm < mean, low, high)) ** 2)

    matching = np.stack(
        [
            0.362 * lobe(442.0, 0.0624, 0.0374)
            + 1.056 * lobe(599.8, 0.0264, 0.0323)
            - 0.065 * lobe(501.1, 0.0490, 0.0382),
            0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322),
            1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725),
        ]
    )
    to_rgb = np.array(
        [
            [3.2404542, -1.5371385, -0.4985314],
            [-0.9692660, 1.8760108, 0.0415560],
            [0.0556434, -0.2040259, 1.0572252],
        ]
    )
    rgb = np.maximum(to_rgb @ (matching @ radiance), 0)
    return tuple((rgb / rgb.max()).tolist())


_texture = texture
