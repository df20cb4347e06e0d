"""Lights and portals that entities carry."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .._wire._proto import scene_pb2 as scene
from .._wire._proto import types_pb2 as types
from ..errors import InvalidArgument
from .checks import color_of, number_of
from .components import Tex

_UNITS = (
    *("radiance", "power", "luminance", "lumen", "irradiance", "illuminance"),
    *("intensity", "candela", "profile_scale"),
)
_SHAPES = ("mesh", "sphere", "disc", "rectangle")


@dataclass(frozen=True)
class Light:
    """Light that an entity's mesh gives off, besides its material's emission; a shape; or a sun.

    Strength, exactly one of: `radiance` (W sr^-1 m^-2), `power` (W over all emitting sides, each
    channel), `luminance` (cd m^-2), `lumen` (lm over all emitting sides); for suns also
    `irradiance` (W m^-2) and `illuminance` (lx) of a surface that faces the sun; for shapes also
    `intensity` (W/sr) and `candela` (cd) along the axis, with a `profile` in its strongest
    direction, and `profile_scale`, a factor of the profile's own candela, which is 1 where there is
    a profile and no strength.
    color: number or (3,), linear. exposure: stops. temperature: kelvin, 0 for none.
    two_sided: the back emits too. texture: a texture or Tex that multiplies the radiance.
    shape: "mesh", the entity's own; or, without a mesh, "sphere", "disc" or "rectangle" about the
    entity's origin, which shine along its -Z axis. radius: of a sphere or disc, metres (1).
    width, height: of a rectangle along x and y, metres (1). The entity's scale multiplies them.
    profile: a texture of intensities by direction, for shapes without a cone: that of an .ies file,
    edit.texture(name, "lamp.ies"); or an array, rows by the angle to -Z (0 .. pi), columns by that
    about +Z from +X towards +Y (0 .. 2 pi, the end left out). docs/lights.md.
    outer_cone_angle: makes a shape a spot light; half angle about -Z at which its cone ends,
    radians, up to pi / 2. inner_cone_angle: up to which it has its whole strength.
    sun_angle: makes it a sun, a disc infinitely far away that shines along the entity's -Z axis and
    needs no mesh; its angular diameter, radians (ours: 0.0093). 0: no sun.
    """

    radiance: float | None = None
    power: float | None = None
    luminance: float | None = None
    lumen: float | None = None
    irradiance: float | None = None
    illuminance: float | None = None
    intensity: float | None = None
    candela: float | None = None
    profile_scale: float | None = None
    color: Any = 1.0
    exposure: float = 0.0
    temperature: float = 0.0
    two_sided: bool = False
    texture: Any = None
    sun_angle: float = 0.0
    shape: str = "mesh"
    radius: float | None = None
    width: float | None = None
    height: float | None = None
    inner_cone_angle: float = 0.0
    outer_cone_angle: float = 0.0
    profile: Any = None

    def to_message(self) -> scene.Light:
        strengths = {name: getattr(self, name) for name in _UNITS}
        given = [name for name, value in strengths.items() if value is not None]
        if not given and self.profile is not None:
            given, strengths["profile_scale"] = ["profile_scale"], 1.0
        if len(given) != 1:
            units = "=, ".join(_UNITS)
            raise InvalidArgument(f"light: give exactly one of {units}=", field="light")
        unit: Any = scene.Light.Unit.Value("UNIT_" + given[0].upper())
        message = scene.Light(
            color=color_of(self.color, "light.color"),
            intensity=number_of(strengths[given[0]], f"light.{given[0]}"),
            unit=unit,
            exposure=number_of(self.exposure, "light.exposure"),
            temperature=number_of(self.temperature, "light.temperature"),
            two_sided=bool(self.two_sided),
        )
        for name in ("sun_angle", "inner_cone_angle", "outer_cone_angle"):
            if getattr(self, name):
                setattr(message, name, _angle(getattr(self, name), f"light.{name}"))
        for name in ("radius", "width", "height"):
            if getattr(self, name) is not None:
                setattr(message, name, number_of(getattr(self, name), f"light.{name}"))
        if self.shape not in _SHAPES:
            raise InvalidArgument(f"light.shape: one of {', '.join(_SHAPES)}", field="light.shape")
        if self.shape != "mesh":
            shape: Any = scene.Light.Shape.Value("SHAPE_" + self.shape.upper())
            message.shape = shape
        return message

    @classmethod
    def from_message(cls, message: scene.Light, handle: Callable[[types.Ref], Any]) -> Light:
        """Light of the daemon's message. handle: gives the object that a Ref names; None for
        none."""
        name = scene.Light.Unit.Name(message.unit or 1)[len("UNIT_") :].lower()
        color = message.color
        sizes = {
            n: getattr(message, n) for n in ("radius", "width", "height") if message.HasField(n)
        }
        return cls(
            **{name: message.intensity},
            **sizes,
            color=(color.x, color.y, color.z) if message.HasField("color") else 1.0,
            exposure=message.exposure,
            temperature=message.temperature,
            two_sided=message.two_sided,
            texture=Tex.from_message(message.texture, handle),
            sun_angle=message.sun_angle,
            shape=scene.Light.Shape.Name(message.shape or 1)[len("SHAPE_") :].lower(),
            inner_cone_angle=message.inner_cone_angle,
            outer_cone_angle=message.outer_cone_angle,
            profile=handle(message.profile),
        )


def _angle(value: Any, field: str) -> float:
    angle = number_of(value, field)
    if angle > math.pi:  # the daemon's limits are tighter
        raise InvalidArgument(f"{field}: {angle:g} is above pi; give radians", field=field)
    return angle


@dataclass(frozen=True)
class Portal:
    """A rectangle about the entity's origin; the dome shines through it along its -Z axis.

    It changes no picture in the mean: it marks where light comes in, so that rooms are less noisy.
    width, height: metres along x and y; the entity's scale multiplies them.
    """

    width: float = 1.0
    height: float = 1.0

    def to_message(self) -> scene.Portal:
        return scene.Portal(
            width=number_of(self.width, "portal.width"),
            height=number_of(self.height, "portal.height"),
        )

    @classmethod
    def from_message(cls, message: scene.Portal) -> Portal:
        return cls(message.width, message.height)
