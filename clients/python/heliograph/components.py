"""What an entity can carry: cameras, lights, visibility; and textures that drive parameters."""

from __future__ import annotations

import difflib
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arrays import NdArray, checked
from ._proto import scene_pb2 as scene
from ._proto import types_pb2 as types
from .errors import InvalidArgument


def refuse_unknown(given: Mapping[str, Any], known: type, what: str) -> None:
    """InvalidArgument with the nearest names when a keyword is none of the TypedDict's."""
    for name in given:
        if name not in known.__annotations__:
            near = difflib.get_close_matches(name, known.__annotations__, 3)
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise InvalidArgument(f"{what} has no {name!r}{hint}", field=name)


def color_of(value: Any, field: str) -> types.Vec3:
    """A Vec3 of a number (grey) or (3,)."""
    if np.ndim(value) == 0:
        value = (value, value, value)
    x, y, z = (float(v) for v in checked(value, field, "f8", (3,)))
    return types.Vec3(x=x, y=y, z=z)


def number_of(value: Any, field: str) -> float:
    """A finite float."""
    return float(checked(value, field, "f8", ()))


def text_of(value: Any, field: str) -> str:
    """A str, and nothing that only looks like one."""
    if isinstance(value, str):
        return value
    raise InvalidArgument(f"{field}: needs a str, not {value!r}", field=field)


def whole_of(value: Any, field: str, low: int = 0, high: int = 2**32 - 1) -> int:
    """A whole number in [low, high]."""
    try:
        whole = operator.index(value)
    except TypeError:
        number = number_of(value, field)
        if number % 1:
            raise InvalidArgument(f"{field}: {value} is no whole number", field=field) from None
        whole = int(number)
    if not low <= whole <= high:
        raise InvalidArgument(
            f"{field}: {whole} is outside [{low}, {high}]; give a whole number in it", field=field
        )
    return whole


@dataclass(frozen=True)
class Camera:
    """A pinhole or orthographic camera: OpenCV intrinsics at the calibrated size.

    width, height: pixels. fx, fy: pixels (orthographic: pixels a metre). cx, cy: principal point,
    where integers are pixel centres. The camera looks down its -Z axis, +Y is up in the image.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    projection: str = "perspective"

    @classmethod
    def from_intrinsics(cls, K: Any, width: int, height: int) -> Camera:
        """From a (3, 3) matrix of OpenCV; K read back equals K."""
        k = checked(K, "K", "f8", (3, 3))
        if k[0, 1] or k[1, 0] or (k[2] != (0, 0, 1)).any():
            raise InvalidArgument(
                "K: needs [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is not modelled", field="K"
            )
        return cls(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))

    @classmethod
    def from_fov(
        cls, fov: float, width: int, height: int, *, axis: str = "x", degrees: bool = False
    ) -> Camera:
        """From the full angle of view along the image's width (`axis="x"`) or height ("y");
        radians unless `degrees`."""
        angle = math.radians(fov) if degrees else float(fov)
        if not 0 < angle < math.pi:
            raise InvalidArgument(
                f"fov: {fov} is not between 0 and 180 degrees; radians unless degrees=True",
                field="fov",
            )
        if axis not in ("x", "y"):
            raise InvalidArgument(f'axis: "x" or "y", not {axis!r}', field="axis")
        focal = 0.5 * (width if axis == "x" else height) / math.tan(0.5 * angle)
        return cls(width, height, focal, focal, 0.5 * width - 0.5, 0.5 * height - 0.5)

    @classmethod
    def from_focal(
        cls, focal: float, width: int, height: int, *, sensor_width: float = 0.036
    ) -> Camera:
        """From a focal length and the sensor's width, both in metres (0.050 on 0.036)."""
        pixels = number_of(focal, "focal") / number_of(sensor_width, "sensor_width") * width
        if not pixels > 0:
            raise InvalidArgument("focal, sensor_width: need metres > 0", field="focal")
        return cls(width, height, pixels, pixels, 0.5 * width - 0.5, 0.5 * height - 0.5)

    @classmethod
    def orthographic(cls, pixels_per_metre: float, width: int, height: int) -> Camera:
        """Parallel rays; one metre is `pixels_per_metre` pixels at any distance."""
        cx, cy = 0.5 * width - 0.5, 0.5 * height - 0.5
        return cls(width, height, pixels_per_metre, pixels_per_metre, cx, cy, "orthographic")

    @property
    def K(self) -> NdArray:
        """(3, 3) float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def to_message(self) -> scene.Camera:
        if self.projection not in ("perspective", "orthographic"):
            raise InvalidArgument("projection: perspective or orthographic", field="projection")
        projection: Any = scene.Camera.Projection.Value(f"PROJECTION_{self.projection.upper()}")
        return scene.Camera(
            width=whole_of(self.width, "camera.width", 1),
            height=whole_of(self.height, "camera.height", 1),
            projection=projection,
            **{n: number_of(getattr(self, n), f"camera.{n}") for n in ("fx", "fy", "cx", "cy")},
        )

    @classmethod
    def from_message(cls, message: scene.Camera) -> Camera:
        ortho = message.projection == scene.Camera.PROJECTION_ORTHOGRAPHIC
        return cls(
            message.width,
            message.height,
            message.fx,
            message.fy,
            message.cx,
            message.cy,
            "orthographic" if ortho else "perspective",
        )


_UNITS = ("radiance", "power", "luminance", "lumen", "irradiance", "illuminance")


@dataclass(frozen=True)
class Light:
    """Light that an entity's mesh gives off, besides what its material emits; or a sun.

    Strength, exactly one of: `radiance` (W sr^-1 m^-2), `power` (W over all emitting sides, each
    channel), `luminance` (cd m^-2), `lumen` (lm over all emitting sides); for suns also
    `irradiance` (W m^-2) and `illuminance` (lx) of a surface that faces the sun.
    color: number or (3,), linear. exposure: stops. temperature: kelvin, 0 for none.
    two_sided: the back emits too. texture: a texture or Tex that multiplies the radiance.
    sun_angle: makes it a sun, a disc infinitely far away that shines along the entity's -Z axis and
    needs no mesh; its angular diameter, radians (ours: 0.0093). 0: the mesh emits.
    """

    radiance: float | None = None
    power: float | None = None
    luminance: float | None = None
    lumen: float | None = None
    irradiance: float | None = None
    illuminance: float | None = None
    color: Any = 1.0
    exposure: float = 0.0
    temperature: float = 0.0
    two_sided: bool = False
    texture: Any = None
    sun_angle: float = 0.0

    def to_message(self) -> scene.Light:
        given = [name for name in _UNITS if getattr(self, name) is not None]
        if len(given) != 1:
            raise InvalidArgument(
                "light: give exactly one of radiance=, power=, luminance=, lumen=, irradiance=, "
                "illuminance=",
                field="light",
            )
        unit: Any = scene.Light.Unit.Value("UNIT_" + given[0].upper())
        message = scene.Light(
            color=color_of(self.color, "light.color"),
            intensity=number_of(getattr(self, given[0]), f"light.{given[0]}"),
            unit=unit,
            exposure=number_of(self.exposure, "light.exposure"),
            temperature=number_of(self.temperature, "light.temperature"),
            two_sided=bool(self.two_sided),
        )
        if self.sun_angle:
            message.sun_angle = number_of(self.sun_angle, "light.sun_angle")
        return message

    @classmethod
    def from_message(cls, message: scene.Light) -> Light:
        name = scene.Light.Unit.Name(message.unit or 1)[len("UNIT_") :].lower()
        color = message.color
        return cls(
            **{name: message.intensity},
            color=(color.x, color.y, color.z) if message.HasField("color") else 1.0,
            exposure=message.exposure,
            temperature=message.temperature,
            two_sided=message.two_sided,
            sun_angle=message.sun_angle,
        )


@dataclass(frozen=True)
class Visibility:
    """Which rays meet an entity's surface."""

    camera: bool = True
    diffuse: bool = True
    glossy: bool = True
    transmission: bool = True
    shadow: bool = True
    volume: bool = True

    def to_message(self) -> scene.Visibility:
        return scene.Visibility(
            camera=self.camera,
            diffuse=self.diffuse,
            glossy=self.glossy,
            transmission=self.transmission,
            shadow=self.shadow,
            volume=self.volume,
        )


@dataclass(frozen=True)
class Tex:
    """A texture that drives a parameter: (texel[channel] * scale + offset) * factor.

    texture: a handle or a name. factor: the constant it multiplies, number or (3,).
    channel: 0..3, for scalar parameters. uv: (2, 3), applied to (u, v, 1). uv_set: 0 or 1.
    """

    texture: Any
    factor: Any = 1.0
    channel: int = 0
    scale: float = 1.0
    offset: float = 0.0
    uv: Any = None
    uv_set: int = 0
