"""A clear sky and its sun, computed from the air. Called by Edits.sky()."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument
from .lights import Light
from .pose import look_at

if TYPE_CHECKING:
    from ..client.edit import Edits

# Per metre at sea level, for wavelengths of 680, 550 and 440 nm; heights in metres.
# Source: Hillaire 2020, "A Scalable and Production Ready Sky and Atmosphere Rendering Technique",
# table 1 (after Bruneton and Neyret 2008).
_RAYLEIGH = np.array([5.802e-6, 13.558e-6, 33.1e-6])
_MIE_SCATTERING, _MIE_ABSORPTION = 3.996e-6, 0.444e-6
_OZONE = np.array([0.650e-6, 1.881e-6, 0.085e-6])
_RAYLEIGH_HEIGHT, _MIE_HEIGHT = 8000.0, 1200.0
_MIE_ASYMMETRY = 0.8
_GROUND, _TOP = 6.360e6, 6.460e6
# Linear Rec.709 of 128 klx of black-body light of 5,772 K (683 lm/W): the sun outside the air.
_SUN_OUTSIDE = 128e3 / 683 * np.array([1.1023, 0.9795, 0.9035])
SUN_ANGLE = 0.0093
_STEPS = 24
_AZIMUTHS = 64  # at which the integrals are made; the phase functions know every column


@dataclass(frozen=True)
class Sky:
    """radiance: (H, W, 3) float32, W sr^-1 m^-2, lat-long with row 0 at +Z, sun not included.
    sun_irradiance: (3,) W m^-2 on a surface that faces the sun. sun_direction: (3,) to the sun."""

    radiance: NdArray
    sun_irradiance: NdArray
    sun_direction: NdArray


def _densities(height: NdArray) -> tuple[NdArray, NdArray, NdArray]:
    ozone = np.maximum(0, 1 - np.abs(height - 25e3) / 15e3)
    return np.exp(-height / _RAYLEIGH_HEIGHT), np.exp(-height / _MIE_HEIGHT), ozone


def _extinction(height: NdArray, aerosol: float) -> NdArray:
    rayleigh, mie, ozone = _densities(height)
    haze = aerosol * (_MIE_SCATTERING + _MIE_ABSORPTION)
    sum_: NdArray = rayleigh[..., None] * _RAYLEIGH + mie[..., None] * haze
    sum_ += ozone[..., None] * _OZONE
    return sum_


def _to_sphere(radius: NdArray, cosine: NdArray, sphere: float) -> NdArray:
    """Distance to the far side of a sphere about the earth's middle; nan where it is missed."""
    with np.errstate(invalid="ignore"):
        far: NdArray = np.sqrt(radius**2 * (cosine**2 - 1) + sphere**2) - radius * cosine
    return far


def _meets_ground(radius: NdArray, cosine: NdArray) -> NdArray:
    meets: NdArray = (cosine < 0) & (radius**2 * (cosine**2 - 1) + _GROUND**2 > 0)
    return meets


def _steps(length: NdArray) -> tuple[NdArray, NdArray]:
    """Middles and lengths of steps that grow with the square of the distance."""
    edges = np.linspace(0, 1, _STEPS + 1) ** 2
    return length[..., None] * 0.5 * (edges[1:] + edges[:-1]), length[..., None] * np.diff(edges)


class _Air:
    """Tables over (height, cosine of the sun's zenith angle), as of Hillaire 2020, sections 5.2
    and 5.5."""

    def __init__(self, aerosol: float, albedo: float) -> None:
        self.aerosol, self.albedo = aerosol, albedo
        heights = np.linspace(0, 1, 24) ** 2 * (_TOP - _GROUND - 1)
        cosines = np.sinh(np.linspace(-3, 3, 64)) / math.sinh(3)
        self.heights, self.cosines = heights, cosines
        self.transmittance = self._transmittance(heights[:, None], cosines[None, :])
        self.multiple = self._multiple()

    def _transmittance(self, height: NdArray, cosine: NdArray) -> NdArray:
        radius = _GROUND + height + 0 * cosine
        cosine = cosine + 0 * height
        t, dt = _steps(_to_sphere(radius, cosine, _TOP))
        r = np.sqrt(radius[..., None] ** 2 + t**2 + 2 * (radius * cosine)[..., None] * t)
        depth = (_extinction(np.maximum(r - _GROUND, 0), self.aerosol) * dt[..., None]).sum(-2)
        lit = ~_meets_ground(radius, cosine)
        passed: NdArray = np.exp(-depth) * lit[..., None]
        return passed

    def look_up(self, table: NdArray, height: NdArray, cosine: NdArray) -> NdArray:
        """height: (...,). cosine: (..., K) at each height. Returns (..., K, 3)."""
        y = np.interp(height, self.heights, np.arange(len(self.heights)))
        i = np.minimum(y.astype(int), len(self.heights) - 2)
        v = (y - i)[..., None, None]
        rows = (table[i] * (1 - v) + table[i + 1] * v).reshape(-1, 3)
        x = np.interp(cosine, self.cosines, np.arange(len(self.cosines)))
        j = np.minimum(x.astype(int), len(self.cosines) - 2)
        u = (x - j)[..., None]
        j += np.arange(height.size).reshape(*height.shape, 1) * len(self.cosines)
        value: NdArray = rows[j] * (1 - u) + rows[j + 1] * u
        return value

    def rays(self, radius: float, cosine: NdArray) -> _Rays:
        """Rays from a distance to the earth's middle, at cosines to the zenith (N,)."""
        grounded = _meets_ground(radius + 0 * cosine, cosine)
        near = -radius * cosine - np.sqrt(np.maximum(radius**2 * (cosine**2 - 1) + _GROUND**2, 0))
        length = np.where(grounded, near, _to_sphere(radius + 0 * cosine, cosine, _TOP))
        t, dt = _steps(np.maximum(length, 0))
        r = np.sqrt(radius**2 + t**2 + 2 * radius * cosine[:, None] * t)
        height = np.maximum(r - _GROUND, 0)
        extinction = _extinction(height, self.aerosol)
        each = extinction * dt[..., None]
        depth = np.cumsum(each, axis=-2)
        weight = np.exp(each - depth) * (1 - np.exp(-each)) / extinction
        rayleigh, mie, _ = _densities(height)
        return _Rays(
            t,
            r,
            weight * rayleigh[..., None] * _RAYLEIGH,
            weight * (mie * self.aerosol * _MIE_SCATTERING)[..., None],
            np.exp(-depth[:, -1]) * grounded[:, None],
        )

    def _multiple(self) -> NdArray:
        """Radiance of light that has scattered twice or more, the same in all directions: the
        second order's mean, times the geometric series of all further ones."""
        views = _sphere_of_directions(24)
        suns = np.stack([np.sqrt(1 - self.cosines**2), 0 * self.cosines, self.cosines], axis=-1)
        table = np.zeros((len(self.heights), len(self.cosines), 3))
        for i, height in enumerate(self.heights):
            radius = _GROUND + height + 1.0
            rays = self.rays(radius, views[:, 2])
            up = rays.cosines_to_sun(radius, suns[:, 2], views @ suns.T)
            scattered = rays.by_rayleigh + rays.by_mie
            sunlight = self.look_up(self.transmittance, rays.heights, up)
            second = np.einsum("nsc,nskc->nkc", scattered, sunlight) / (4 * np.pi)
            ground = up[:, -1]
            lit = self.look_up(self.transmittance, np.zeros(len(views)), ground)
            bounced = lit * np.maximum(ground, 0)[..., None] * self.albedo / np.pi
            second += rays.to_ground[:, None] * bounced
            table[i] = second.mean(0) / (1 - scattered.sum(1).mean(0))
        return table


class _Rays(NamedTuple):
    """N rays in steps (S): all that does not depend on the sun."""

    t: NdArray  # (N, S) distances of the steps' middles
    r: NdArray  # (N, S) their distances to the earth's middle
    by_rayleigh: NdArray  # (N, S, 3) light that scatters there for a phase function of 1
    by_mie: NdArray
    to_ground: NdArray  # (N, 3) share of light from the ground; 0 where the ray misses it

    @property
    def heights(self) -> NdArray:
        return np.maximum(self.r - _GROUND, 0)

    def cosines_to_sun(self, radius: float, zenith: NdArray, view: NdArray) -> NdArray:
        """(N, S, K) cosines of the sun's zenith angle along the rays. zenith: (K,) at their origin.
        view: (N, K) cosines between rays and sun."""
        up: NdArray = (radius * zenith + self.t[..., None] * view[:, None]) / self.r[..., None]
        return up


def _rayleigh_phase(cosine: NdArray) -> NdArray:
    return 3 / (16 * np.pi) * (1 + cosine**2)


def _mie_phase(cosine: NdArray) -> NdArray:
    """Cornette and Shanks 1992."""
    g = _MIE_ASYMMETRY
    scale = 3 / (8 * np.pi) * (1 - g * g) / (2 + g * g)
    return scale * (1 + cosine**2) / (1 + g * g - 2 * g * cosine) ** 1.5


def _sphere_of_directions(count: int) -> NdArray:
    """Directions on a spherical Fibonacci lattice."""
    i = np.arange(count) + 0.5
    z, phi = 1 - 2 * i / count, np.pi * (1 + math.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


class AirOptions(TypedDict, total=False):
    """aerosol: haze, [0, 20]; 0: none, default 1: clear air. albedo: of the ground, which fills the
    lower half, [0, 1]; default 0.3. width: of the picture, pixels; default 512. height: of the eye
    above the ground, metres, [0, 50000]; default 0.
    """

    aerosol: float
    albedo: float
    width: int
    height: float


def put(edit: Edits, name: str, made: Sky) -> None:
    """Writes a sky to the scene, its sun as the entity `name`."""
    edit.dome(made.radiance, color=1.0, intensity=1.0, rotation=0.0)
    light = Light(irradiance=1.0, color=made.sun_irradiance, sun_angle=SUN_ANGLE)
    edit.entity(name, light=light, transform=look_at(made.sun_direction, (0.0, 0.0, 0.0)))


def sky(
    elevation: float,
    azimuth: float = 0.0,
    *,
    aerosol: float = 1.0,
    albedo: float = 0.3,
    width: int = 512,
    height: float = 0.0,
) -> Sky:
    """Light of air without clouds; the arguments are Edits.sky()'s.

    Single scattering is integrated along each direction, all further ones are isotropic.
    """
    _check(elevation, aerosol, albedo, width, height)
    air = _air(float(aerosol), float(albedo))
    sun = np.array([math.cos(elevation), 0.0, math.sin(elevation)])
    # The picture is symmetric about the sun's azimuth: half of it, the sun at its first column.
    rows = columns = width // 2
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    above = rows // 2
    radiance = np.zeros((rows, columns, 3))
    radiance[:above] = _half_sky(air, _GROUND + height + 1.0, theta[:above], sun)
    direct = air.look_up(air.transmittance, np.array(height + 1.0), sun[2:])[0]
    weights = np.cos(theta[:above]) * np.sin(theta[:above]) * 2 * np.pi**2 / (rows * columns)
    diffuse = (radiance[:above] * weights[:, None, None]).sum((0, 1))
    radiance[above:] = albedo / np.pi * (diffuse + direct * max(sun[2], 0.0))
    # u = 0.5 - phi / 2 pi: columns from phi = pi down to -pi, then turned by the azimuth.
    picture = np.concatenate([radiance[:, ::-1], radiance], axis=1)
    turn = -azimuth / (2 * np.pi) * width
    low = math.floor(turn)
    picture = (1 - turn + low) * np.roll(picture, low, 1) + (turn - low) * np.roll(
        picture, low + 1, 1
    )
    direction = np.array(
        [sun[0] * math.cos(azimuth), sun[0] * math.sin(azimuth), math.sin(elevation)]
    )
    return Sky((picture * _SUN_OUTSIDE).astype(np.float32), direct * _SUN_OUTSIDE, direction)


def _check(elevation: float, aerosol: float, albedo: float, width: int, height: float) -> None:
    for name, value, low, high, unit in (
        ("elevation", elevation, -math.pi / 2, math.pi / 2, " radians"),
        ("aerosol", aerosol, 0.0, 20.0, ""),
        ("albedo", albedo, 0.0, 1.0, ""),
        ("height", height, 0.0, 50e3, " m"),
    ):
        if not low <= value <= high:
            raise InvalidArgument(
                f"{name}: {value} is not in [{low:g}, {high:g}]{unit}", field=name
            )
    if width < 8 or width % 4:
        raise InvalidArgument(f"width: {width} is not a multiple of 4 from 8 on", field="width")


@lru_cache(maxsize=8)
def _air(aerosol: float, albedo: float) -> _Air:
    return _Air(aerosol, albedo)


def _half_sky(air: _Air, radius: float, theta: NdArray, sun: NdArray) -> NdArray:
    """(N, 2 N, 3) radiance for a sun of irradiance 1 at zenith angles (N,) and azimuths from
    the sun's to the opposite one."""
    columns = 2 * len(theta)
    phi = np.pi * (np.arange(columns) + 0.5) / columns
    coarse = np.linspace(0, np.pi, min(columns, _AZIMUTHS) + 1)
    rays = air.rays(radius, np.cos(theta))
    view = _cosines_between(theta, coarse, sun)
    up = rays.cosines_to_sun(radius, np.full(len(coarse), sun[2]), view)
    sunlight = air.look_up(air.transmittance, rays.heights, up)
    multiple = air.look_up(air.multiple, rays.heights, up)
    x = phi / np.pi * (len(coarse) - 1)
    j = x.astype(int)
    u = (x - j)[:, None]

    def summed(scattered: NdArray, light: NdArray) -> NdArray:
        sums = np.einsum("nsc,nskc->nkc", scattered, light)
        fine: NdArray = sums[:, j] * (1 - u) + sums[:, j + 1] * u
        return fine

    angle = _cosines_between(theta, phi, sun)[..., None]
    radiance = summed(rays.by_rayleigh, sunlight) * _rayleigh_phase(angle)
    radiance += summed(rays.by_mie, sunlight) * _mie_phase(angle)
    return radiance + summed(rays.by_rayleigh + rays.by_mie, multiple)


def _cosines_between(theta: NdArray, phi: NdArray, sun: NdArray) -> NdArray:
    """(N, M) cosines between directions and a sun of azimuth 0."""
    cosines: NdArray = (
        np.sin(theta)[:, None] * np.cos(phi) * sun[0] + np.cos(theta)[:, None] * sun[2]
    )
    return cosines
