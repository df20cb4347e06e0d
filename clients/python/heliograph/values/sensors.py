"""Sensors of a camera: the planes sensor_rgb, sensor_mosaic and sensor_depth. docs/cameras.md."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .._wire._proto import scene_pb2 as scene
from ..errors import InvalidArgument
from .checks import number_of, whole_of

_RGB = ("exposure", "full_well", "read_noise", "black_level", "vignetting")
_PATTERNS = ("none", "rggb", "bggr", "grbg", "gbrg")
_KINDS = {
    "active_stereo": ("baseline", "disparity_noise", "disparity_step", "lateral_noise"),
    "time_of_flight": ("range_noise",),
}
_DEPTH = ("min_signal", "max_angle", "min_depth", "max_depth")


@dataclass(frozen=True)
class RgbSensor:
    """A linear colour sensor; a signal of 1 fills its wells.

    exposure: stops; signal = radiance * 2**exposure. full_well: electrons at a signal of 1, which
    make photon noise; 0: none. read_noise: electrons, standard deviation. black_level: share of the
    output that black reads. bits: of the output, 0 for not quantised. vignetting: share of the
    cosine fourth law, 0 to 1.
    pattern: "rggb", "bggr", "grbg" or "gbrg", the colours of the photosites from the upper left
    corner on: the plane sensor_mosaic is what each reads, sensor_rgb is demosaiced from it. "none":
    each pixel measures all three.
    """

    exposure: float = 0.0
    full_well: float = 0.0
    read_noise: float = 0.0
    black_level: float = 0.0
    bits: int = 0
    vignetting: float = 0.0
    pattern: str = "none"

    def to_message(self) -> scene.RgbSensor:
        if self.pattern not in _PATTERNS:
            raise InvalidArgument(
                f"camera.rgb_sensor.pattern: one of {', '.join(_PATTERNS)}",
                field="camera.rgb_sensor.pattern",
            )
        pattern: Any = scene.RgbSensor.Pattern.Value(f"PATTERN_{self.pattern.upper()}")
        message = scene.RgbSensor(
            bits=whole_of(self.bits, "camera.rgb_sensor.bits"), pattern=pattern
        )
        for name in _RGB:
            setattr(message, name, number_of(getattr(self, name), f"camera.rgb_sensor.{name}"))
        return message

    @classmethod
    def from_message(cls, message: scene.RgbSensor) -> RgbSensor:
        pattern = scene.RgbSensor.Pattern.Name(message.pattern or 1)[len("PATTERN_") :].lower()
        numbers = {name: getattr(message, name) for name in _RGB}
        return cls(bits=message.bits, pattern=pattern, **numbers)


@dataclass(frozen=True)
class DepthSensor:
    """A depth camera; pixels that it cannot measure read 0.

    kind: "active_stereo" (a projector at +x of a perspective camera without distortion) or
    "time_of_flight".
    Active stereo: baseline to the projector, metres; disparity_noise, pixels; disparity_step,
    pixels, 0 for not quantised; lateral_noise, pixels.
    Time of flight: range_noise, metres at a signal of 1; it grows with 1 / sqrt(signal).
    Both: window, pixels (odd) that are matched together or mixed; min_signal, below which there is
    no measurement: a white matt surface at 1 m that faces the camera has 1; max_angle, radians
    between ray and normal; min_depth, max_depth, metres, max_depth 0 for none.
    """

    kind: str = "active_stereo"
    baseline: float = 0.0
    disparity_noise: float = 0.0
    disparity_step: float = 0.0
    lateral_noise: float = 0.0
    range_noise: float = 0.0
    window: int = 1
    min_signal: float = 0.0
    max_angle: float = math.pi / 2
    min_depth: float = 0.0
    max_depth: float = 0.0

    def to_message(self) -> scene.DepthSensor:
        if self.kind not in _KINDS:
            raise InvalidArgument(
                f"camera.depth_sensor.kind: one of {', '.join(_KINDS)}", field="camera.depth_sensor"
            )
        kind: Any = scene.DepthSensor.Kind.Value(f"KIND_{self.kind.upper()}")
        message = scene.DepthSensor(
            kind=kind, window=whole_of(self.window, "camera.depth_sensor.window")
        )
        own = (*_DEPTH, *_KINDS[self.kind])
        for name in (*_DEPTH, *(name for names in _KINDS.values() for name in names)):
            number = number_of(getattr(self, name), f"camera.depth_sensor.{name}")
            if number or name in own:  # another kind's is sent to be refused
                setattr(message, name, number)
        return message

    @classmethod
    def from_message(cls, message: scene.DepthSensor) -> DepthSensor:
        kind = scene.DepthSensor.Kind.Name(message.kind or 1)[len("KIND_") :].lower()
        names = (*_DEPTH, *(name for names in _KINDS.values() for name in names))
        fields = {name: getattr(message, name) for name in names}
        return cls(kind=kind, window=message.window, **fields)
