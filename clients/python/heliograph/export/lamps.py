"""Radiance and candela of lights. Used by the writers of files.

The daemon derives the same from the units of docs/lights.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire.arrays import NdArray

LUMENS_PER_WATT = 683.0  #: at white
_SHARPEST_CONE = 1e-3  # difference of cosines; KHR_lights_punctual
_PHOTOMETRIC = ("luminance", "lumen", "illuminance", "candela")
_XYZ_TO_RGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Lobes of the CIE 1931 colour matching functions: weight, mean, widths below and above, in nm.
# Source: Wyman, Sloan & Shirley 2013, JCGT 2(2), equation 4.
_LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)


@dataclass(frozen=True)
class Lamp:
    """A light as in a Light message. shape: "mesh", "sphere", "disc", "rectangle" or "sun"."""

    message: pb.Light

    @property
    def shape(self) -> str:
        if self.message.sun_angle > 0:
            return "sun"
        return pb.Light.Shape.Name(self.message.shape or 1)[len("SHAPE_") :].lower()

    @property
    def unit(self) -> str:
        return pb.Light.Unit.Name(self.message.unit or 1)[len("UNIT_") :].lower()

    @property
    def has_cone(self) -> bool:
        return self.message.outer_cone_angle > 0

    def size(self, name: str) -> float:
        return float(getattr(self.message, name)) if self.message.HasField(name) else 1.0

    def strength(self) -> NdArray:
        """(3,) in the light's unit; of photometric ones in watts."""
        color = self.message.color
        rgb = np.array([color.x, color.y, color.z] if self.message.HasField("color") else [1.0] * 3)
        if self.message.temperature > 0:
            rgb = rgb * planckian_color(self.message.temperature)
        intensity = self.message.intensity if self.message.HasField("intensity") else 1.0
        scale = intensity * 2.0**self.message.exposure
        return np.asarray(rgb * scale / (LUMENS_PER_WATT if self.unit in _PHOTOMETRIC else 1.0))


def planckian_color(kelvin: float) -> NdArray:
    """(3,) linear Rec.709 of luminance 1."""
    nm = np.arange(360.0, 831.0, 5.0)
    power = (nm * 1e-3) ** -5 / np.expm1(1.438776877e7 / (nm * kelvin))
    xyz = [
        sum(float((power * w * _lobe(nm, m, below, above)).sum()) for w, m, below, above in lobes)
        for lobes in _LOBES
    ]
    rgb = np.maximum(_XYZ_TO_RGB @ np.array(xyz), 0)
    return np.asarray(rgb / (rgb @ _LUMINANCE))


def _lobe(x: NdArray, mean: float, below: float, above: float) -> NdArray:
    return np.exp(-0.5 * ((x - mean) / np.where(x < mean, below, above)) ** 2)


# ---------------------------------------------------------------- extents


@dataclass(frozen=True)
class Extent:
    """Flux [W] and intensity along the axis [W/sr] of a light in the world with radiance 1."""

    flux: float
    intensity: float


def mesh_area(positions: NdArray, indices: NdArray, world: NdArray) -> float:
    """m^2 of triangles under (4, 4) world_from_mesh."""
    points = np.asarray(positions, dtype="f8") @ world[:3, :3].T
    a, b, c = (points[indices[:, i]] for i in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def mesh_extent(area: float, two_sided: bool) -> Extent:
    return Extent(math.pi * area * (2 if two_sided else 1), area)


def shape_extent(lamp: Lamp, world: NdArray) -> Extent:
    """Extent of a sphere, disc or rectangle under (4, 4) world_from_light."""
    flux_share, axis_share = _cone_integrals(lamp.message) if lamp.has_cone else (0.0, 0.0)
    if lamp.shape == "sphere":
        area = _ellipsoid_area(world[:3, :3] * lamp.size("radius"))
        return Extent(area / 4 * flux_share if lamp.has_cone else math.pi * area, area / 4)
    area = float(np.linalg.norm(np.cross(world[:3, 0], world[:3, 1])))
    if lamp.shape == "disc":
        area *= math.pi * lamp.size("radius") ** 2
    else:
        area *= lamp.size("width") * lamp.size("height")
    if lamp.has_cone:
        return Extent(area * axis_share, area)
    return mesh_extent(area, lamp.message.two_sided)


def _cone_integrals(light: pb.Light) -> tuple[float, float]:
    """Integrals of a cone's share over directions, plain and times the cosine to the axis, sr."""
    outer, inner = math.cos(light.outer_cone_angle), math.cos(light.inner_cone_angle)
    width = max(_SHARPEST_CONE, inner - outer)
    full = min(1.0, outer + width)
    rise = full - outer
    third, fourth = rise**3 / (3 * width**2), rise**4 / (4 * width**2)
    around = 2 * math.pi
    return around * (third + 1 - full), around * (fourth + outer * third + (1 - full**2) / 2)


def _ellipsoid_area(linear: NdArray) -> float:
    """m^2 of the unit sphere under a linear map: 4 pi times the mean length of cofactors' images of
    its normals, over a Fibonacci lattice."""
    count = 4096
    i = np.arange(count)
    z = 1 - (2 * i + 1) / count
    phi = i * math.pi * (3 - math.sqrt(5))
    r = np.sqrt(1 - z * z)
    normals = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    cofactor = np.linalg.det(linear) * np.linalg.inv(linear).T
    return float(4 * math.pi * np.linalg.norm(normals @ cofactor.T, axis=1).mean())


def radiance(lamp: Lamp, extent: Extent) -> NdArray:
    """(3,) W sr^-1 m^-2 of a mesh's light or a shape's."""
    per_unit = {"power": extent.flux, "lumen": extent.flux}
    per_unit.update(intensity=extent.intensity, candela=extent.intensity)
    one = per_unit.get(lamp.unit, 1.0)
    return np.asarray(lamp.strength() / one if one > 0 else np.zeros(3))


def irradiance(lamp: Lamp) -> NdArray:
    """(3,) W m^-2 of a sun, on a surface that faces it."""
    if lamp.unit in ("irradiance", "illuminance"):
        return lamp.strength()
    share: Any = math.pi * math.sin(0.5 * lamp.message.sun_angle) ** 2
    return np.asarray(lamp.strength() * share)
