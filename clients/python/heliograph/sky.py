"""A clear sky and its sun, computed from the air. Called by Edits.sky()."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from ._arrays import NdArray
from .components import Light
from .errors import InvalidArgument
from .pose import look_at

if TYPE_CHECKING:
    from .edit import Edits

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

    def __init__(self, aerosol: float, albedo: float):
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
        y = np.interp(height, self.heights, np.arange(len(self.heights)))
        x = np.interp(cosine, self.cosines, np.arange(len(self.cosines)))
        i = np.minimum(y.astype(int), table.shape[0] - 2)
        j = np.minimum(x.astype(int), table.shape[1] - 2)
        v, u = (y - i)[..., None], (x - j)[..., None]
        low = table[i, j] * (1 - u) + table[i, j + 1] * u
        high = table[i + 1, j] * (1 - u) + table[i + 1, j + 1] * u
        value: NdArray = low * (1 - v) + high * v
        return value

    def march(
        self, origin: NdArray, view: NdArray, sun: NdArray, isotropic: bool
    ) -> tuple[NdArray, NdArray]:
        """Radiance for a sun of irradiance 1, and the share of it that scatters once on the way.

        origin, view, sun: (..., 3). isotropic: the phase function is 1 / 4 pi and nothing has
        scattered before.
        """
        radius = np.linalg.norm(origin, axis=-1)
        cosine = (origin * view).sum(-1) / radius
        grounded = _meets_ground(radius, cosine)
        near = -radius * cosine - np.sqrt(np.maximum(radius**2 * (cosine**2 - 1) + _GROUND**2, 0))
        length = np.where(grounded, near, _to_sphere(radius, cosine, _TOP))
        t, dt = _steps(np.maximum(length, 0))
        points = origin[..., None, :] + view[..., None, :] * t[..., None]
        r = np.linalg.norm(points, axis=-1)
        height = np.maximum(r - _GROUND, 0)
        up = (points * sun[..., None, :]).sum(-1) / r
        extinction = _extinction(height, self.aerosol)
        depth = np.cumsum(extinction * dt[..., None], axis=-2)
        before = np.exp(-(depth - extinction * dt[..., None]))
        weight = before * (1 - np.exp(-extinction * dt[..., None])) / extinction
        rayleigh, mie, _ = _densities(height)
        by_rayleigh = rayleigh[..., None] * _RAYLEIGH
        by_mie = np.broadcast_to((mie * self.aerosol * _MIE_SCATTERING)[..., None], weight.shape)
        sunlight = self.look_up(self.transmittance, height, up)
        if isotropic:
            source = (by_rayleigh + by_mie) * sunlight / (4 * np.pi)
        else:
            angle = (view * sun).sum(-1)[..., None, None]
            source = sunlight * (by_rayleigh * _rayleigh_phase(angle) + by_mie * _mie_phase(angle))
            source = source + self.look_up(self.multiple, height, up) * (by_rayleigh + by_mie)
        radiance = (weight * source).sum(-2)
        if isotropic:
            lit = self.look_up(self.transmittance, 0 * radius, up[..., -1])
            bounced = lit * np.maximum(up[..., -1], 0)[..., None] * self.albedo / np.pi
            radiance = radiance + np.exp(-depth[..., -1, :]) * bounced * grounded[..., None]
        return radiance, (weight * (by_rayleigh + by_mie)).sum(-2)

    def _multiple(self) -> NdArray:
        """Radiance of light that has scattered twice or more, the same in all directions: the
        second order's mean, times the geometric series of all further ones."""
        views = _sphere_of_directions(24)
        table = np.zeros((len(self.heights), len(self.cosines), 3))
        for i, height in enumerate(self.heights):
            sun = np.stack([np.sqrt(1 - self.cosines**2), 0 * self.cosines, self.cosines], axis=-1)[
                :, None, :
            ]
            origin = np.array([0, 0, _GROUND + height + 1.0])
            shape = (len(self.cosines), len(views), 3)
            second, passed = self.march(
                np.broadcast_to(origin, shape),
                np.broadcast_to(views, shape),
                np.broadcast_to(sun, shape),
                True,
            )
            table[i] = second.mean(1) / (1 - passed.mean(1))
        return table


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
    air = _Air(aerosol, albedo)
    sun = np.array([math.cos(elevation), 0.0, math.sin(elevation)])
    # The picture is symmetric about the sun's azimuth: half of it, the sun at its first column.
    rows = columns = width // 2
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    above = rows // 2
    view = _view(theta[:above], np.pi * (np.arange(columns) + 0.5) / columns)
    origin = np.array([0, 0, _GROUND + height + 1.0])
    radiance = np.zeros((rows, columns, 3))
    radiance[:above] = air.march(
        np.broadcast_to(origin, view.shape), view, np.broadcast_to(sun, view.shape), False
    )[0]
    direct = air.look_up(air.transmittance, np.array(height + 1.0), np.array(sun[2]))
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
    for name, value, low, high in (
        ("elevation", elevation, -math.pi / 2, math.pi / 2),
        ("aerosol", aerosol, 0.0, 20.0),
        ("albedo", albedo, 0.0, 1.0),
        ("height", height, 0.0, 50e3),
    ):
        if not low <= value <= high:
            raise InvalidArgument(f"{name}: {value} is not in [{low:g}, {high:g}]", field=name)
    if width < 8 or width % 4:
        raise InvalidArgument(f"width: {width} is not a multiple of 4 from 8 on", field="width")


def _view(theta: NdArray, phi: NdArray) -> NdArray:
    sine = np.sin(theta)[:, None]
    return np.stack(
        [sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)[:, None] + 0 * phi], axis=-1
    )
