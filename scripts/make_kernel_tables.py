"""Writes the tables of kernels/: sRGB decoding, the inverse of the Blackman-Harris filter's
integral, and albedos of GGX and sheen.

usage: make_kernel_tables.py KERNELS_FOLDER (needs numpy). The results are checked in; run it again
when a size changes.
"""

import pathlib
import sys
from collections.abc import Callable

import numpy as np

MU, ROUGHNESS = 32, 32  # reflection: cosines, roughnesses
GLASS_MU, GLASS_ROUGHNESS, GLASS_IOR = 25, 16, 16  # the middle cosine is the critical one's
GLASS_GRID = 128
FILTER = 128  # intervals of one half
ANISOTROPY, ANISOTROPIC_ROUGHNESS, ANISOTROPIC_PHI, ANISOTROPIC_MU = 9, 16, 8, 20
SHEEN_MU, SHEEN_ROUGHNESS = 64, 16
SHEEN_SMOOTHEST = 0.25  # below, the model reflects more than it gets
GRID = 96  # per side, quadrature points over the sampling square

Alpha = tuple[float, float]  # GGX, along x and y

HEADER = """// {what} Written by scripts/make_kernel_tables.py.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels::inline HELIO_ISA {{

// clang-format off
"""
FOOTER = """// clang-format on

}  // namespace heliograph::kernels::inline HELIO_ISA
"""


def table(name: str, values: np.ndarray, comment: str) -> str:
    numbers = [f"{v:.9g}" for v in np.asarray(values, np.float32).ravel()]
    numbers = [n + ("f" if "." in n or "e" in n else ".0f") for n in numbers]
    rows = [", ".join(numbers[i : i + 8]) for i in range(0, len(numbers), 8)]
    return (
        f"/// {comment}\nHELIO_TABLE float {name}[{len(numbers)}] = {{\n"
        + ",\n".join(rows)
        + "};\n"
    )


def constant(name: str, value: int) -> str:
    return f"inline constexpr u32 {name} = {value};\n"


def srgb() -> np.ndarray:
    x = np.arange(256) / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def blackman_harris() -> np.ndarray:
    x = np.linspace(-0.5, 0.5, 200001)
    a = (0.35875, 0.48829, 0.14128, 0.01168)
    integral = a[0] * x + sum(a[k] * np.sin(2 * np.pi * k * x) / (2 * np.pi * k) for k in (1, 2, 3))
    integral -= integral[0]
    return np.interp(np.linspace(0, 1, FILTER + 1) ** 4 / 2, integral / integral[-1], x)


def lambda_ggx(w: np.ndarray, alpha: Alpha) -> np.ndarray:
    slope = ((w[..., :2] * alpha) ** 2).sum(-1) / np.maximum(w[..., 2] ** 2, 1e-12)
    return (np.sqrt(1 + slope) - 1) / 2


def direction(mu: float, cos_phi: float = 1) -> np.ndarray:
    sine = np.sqrt(1 - mu * mu)
    return np.array([sine * cos_phi, sine * np.sqrt(1 - cos_phi**2), mu])


def visible_normals(wo: np.ndarray, alpha: Alpha, grid: int = GRID) -> np.ndarray:
    """Half vectors distributed by GGX's visible normals (Dupuy and Benyoub 2023)."""
    u = (np.arange(grid) + 0.5) / grid
    u1, u2 = (a.ravel() for a in np.meshgrid(u, u))
    stretch = np.array([*alpha, 1])
    s = wo * stretch
    s /= np.linalg.norm(s)
    z = (1 - u2) * (1 + s[2]) - s[2]
    r = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = np.stack([r * np.cos(2 * np.pi * u1), r * np.sin(2 * np.pi * u1), z], 1) + s
    h *= stretch
    return h / np.linalg.norm(h, axis=1, keepdims=True)


def reflection(wo: np.ndarray, alpha: Alpha) -> tuple[float, float]:
    """Albedo of single scattering for Fresnel 1, and the same weighted by (1 - cos)^5."""
    h = visible_normals(wo, alpha)
    c = h @ wo
    wi = 2 * c[:, None] * h - wo
    lo = lambda_ggx(wo, alpha)
    weight = np.where(wi[:, 2] > 0, (1 + lo) / (1 + lo + lambda_ggx(wi, alpha)), 0)
    return weight.mean(), (weight * (1 - c) ** 5).mean()


def fresnel(c: np.ndarray, eta: float) -> tuple[np.ndarray, np.ndarray]:
    t2 = 1 - (1 - c * c) / eta**2
    t = np.sqrt(np.maximum(t2, 0))
    parallel = (eta * c - t) / (eta * c + t)
    perpendicular = (c - eta * t) / (c + eta * t)
    return np.where(t2 > 0, (parallel**2 + perpendicular**2) / 2, 1), t


def glass(wo: np.ndarray, alpha: Alpha, eta: float) -> tuple[float, ...]:
    """Shares of light in one scattering, as kGlassAlbedo has them."""
    h = visible_normals(wo, alpha, GLASS_GRID)
    c = h @ wo
    f, t = fresnel(c, eta)
    lo = lambda_ggx(wo, alpha)
    up = 2 * c[:, None] * h - wo
    down = (c / eta - t)[:, None] * h - wo / eta
    g_up = (1 + lo) / (1 + lo + lambda_ggx(up, alpha)) * (up[:, 2] > 0)
    g_down = (1 + lo) / (1 + lo + lambda_ggx(down, alpha)) * ((down[:, 2] < 0) & (f < 1))
    shares = (f * g_up * (f < 1), g_up * (f == 1), (1 - f) * g_down, f * g_down)
    return tuple(share.mean() for share in shares)


def sheen_lambda(c: np.ndarray, alpha: float) -> np.ndarray:
    rough = np.array([21.5473, 3.82987, 0.19823, -1.97760, -4.32054])
    smooth = np.array([25.3245, 3.32435, 0.16801, -1.27393, -4.85967])
    a, b, power, d, e = rough + (smooth - rough) * (1 - alpha) ** 2

    def fit(x: np.ndarray) -> np.ndarray:
        return a / (1 + b * x**power) + d * x + e

    half = fit(np.array(0.5))
    return np.where(
        c < 0.5, np.exp(fit(np.minimum(c, 0.5))), np.exp(2 * half - fit(1 - np.maximum(c, 0.5)))
    )


def sheen(mu: float, roughness: float) -> float:
    """Albedo of sheen (Conty and Kulla 2017)."""
    alpha = roughness**2
    n = 4 * GRID
    u = (np.arange(n) + 0.5) / n
    z, phi = np.meshgrid(u, u * np.pi)
    sine = np.sqrt(1 - z * z)
    wo = direction(mu)
    h = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], -1) + wo
    h_z = h[..., 2] / np.linalg.norm(h, axis=-1)
    density = (2 + 1 / alpha) * (1 - h_z**2) ** (0.5 / alpha) / (2 * np.pi)
    masking = 1 / (1 + sheen_lambda(z, alpha) + sheen_lambda(np.array(mu), alpha))
    return (density * masking).mean() * 2 * np.pi / (4 * mu)


def alpha_of(i: int, n: int) -> float:
    return max((i / (n - 1)) ** 2, 1e-4)


def isotropic(i: int, n: int) -> Alpha:
    return (alpha_of(i, n), alpha_of(i, n))


def anisotropic(i: int, r: int) -> Alpha:
    """Of the aspect and roughness of a row of the table."""
    aspect = 1 - i / (ANISOTROPY - 1) * (1 - np.sqrt(0.1))
    alpha = alpha_of(r, ANISOTROPIC_ROUGHNESS)
    return (alpha / aspect, alpha * aspect)


def mu_of(i: int, n: int) -> float:
    return max((i / (n - 1)) ** 2, 1e-4)


def axis(x: np.ndarray, alpha: float) -> np.ndarray:
    """Where cosines lie in a table: axis_place() of ggx.h."""
    return (x * (1 + alpha) / (x + alpha) + np.sqrt(x)) / 2


def glass_axis(mu: np.ndarray, alpha: float, eta: float) -> np.ndarray:
    """glass_place() of ggx.h."""
    if eta > 1:
        return axis(mu, alpha)
    critical = np.sqrt(1 - eta * eta)
    below, above = np.clip(mu / critical, 0, 1), np.clip((mu - critical) / (1 - critical), 0, 1)
    low = (axis(below, alpha / critical) + 1 - axis(1 - below, alpha / critical)) / 2
    return np.where(mu < critical, low, 1 + axis(above, alpha / (1 - critical))) / 2


def cosine_at(place: float, axis_of: Callable[[float], float]) -> float:
    """The cosine that an axis has at a place."""
    low, high = 1e-6, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if axis_of(middle) < place else (low, middle)
    return low


def cosine_average(row: np.ndarray, alpha: float) -> float:
    """Of a row over axis(), interpolated as kernels do, so that the furnace closes with it."""
    x, w = np.polynomial.legendre.leggauss(400)
    root = (x + 1) / 2  # of the cosine: the ends count
    mu = root**2
    places = np.arange(len(row)) / (len(row) - 1)
    return np.sum(w * 2 * root * mu * np.interp(axis(mu, alpha), places, row))


def cos_phi_average(values: np.ndarray) -> np.ndarray:
    """Over the azimuth, of values over cos(phi) that are interpolated linearly."""
    cos_phi = np.cos((np.arange(400) + 0.5) / 400 * np.pi / 2)
    return np.interp(cos_phi, np.arange(len(values)) / (len(values) - 1), values).mean()


def reflection_row(alpha: Alpha, cosines: int, cos_phi: float = 1) -> tuple[np.ndarray, float]:
    """Albedos over axis(), and the alpha that wo sees, which is the axis'."""
    seen = float(np.hypot(alpha[0] * cos_phi, alpha[1] * np.sqrt(1 - cos_phi**2)))
    places = np.arange(cosines) / (cosines - 1)
    mu = [cosine_at(place, lambda x: float(axis(np.array(x), seen))) for place in places]
    return np.array([reflection(direction(m, cos_phi), alpha) for m in mu]), seen


def averages(row: tuple[np.ndarray, float]) -> list[float]:
    return [cosine_average(row[0][:, k], row[1]) for k in (0, 1)]


def reflection_tables() -> str:
    rows = [reflection_row(isotropic(r, ROUGHNESS), MU) for r in range(ROUGHNESS)]
    albedo = np.array([row[0] for row in rows])
    average = [averages(row) for row in rows]
    stretched_rows = [
        [
            [
                reflection_row(anisotropic(i, r), ANISOTROPIC_MU, p / (ANISOTROPIC_PHI - 1))
                for p in range(ANISOTROPIC_PHI)
            ]
            for r in range(ANISOTROPIC_ROUGHNESS)
        ]
        for i in range(ANISOTROPY)
    ]
    stretched = np.array([[[row[0] for row in rows] for rows in plane] for plane in stretched_rows])
    stretched_average = [
        [
            [cos_phi_average(np.array([averages(row)[k] for row in rows])) for k in (0, 1)]
            for rows in plane
        ]
        for plane in stretched_rows
    ]
    return (
        constant("kAlbedoCosines", MU)
        + constant("kAlbedoRoughnesses", ROUGHNESS)
        + table("kReflectionAlbedo", albedo, "[roughness][axis_place()][Fresnel 1, (1 - cos_h)^5]")
        + table(
            "kReflectionAverage",
            average,
            "[roughness][the same two], averaged over the hemisphere by cosine",
        )
        + constant("kAnisotropies", ANISOTROPY)
        + constant("kAnisotropicRoughnesses", ANISOTROPIC_ROUGHNESS)
        + constant("kAnisotropicPhis", ANISOTROPIC_PHI)
        + constant("kAnisotropicCosines", ANISOTROPIC_MU)
        + table(
            "kAnisotropicAlbedo",
            stretched,
            "[aspect, from 1 to sqrt(0.1)][roughness][cos(phi)][axis_place()][the same two]",
        )
        + table("kAnisotropicAverage", stretched_average, "[aspect][roughness][the same two]")
    )


def glass_row(m: int, alpha: Alpha, eta: float) -> tuple[float, ...]:
    mu = cosine_at(m / (GLASS_MU - 1), lambda x: float(glass_axis(np.array(x), alpha[0], eta)))
    return glass(direction(mu), alpha, eta)


def glass_table() -> str:
    top = np.sqrt(3 / 5)
    iors = [max((1 + x * x) / (1 - x * x), 1.001) for x in np.linspace(0, top, GLASS_IOR)]
    inside = np.array(
        [
            [
                [
                    [glass_row(m, isotropic(r, GLASS_ROUGHNESS), eta) for m in range(GLASS_MU)]
                    for r in range(GLASS_ROUGHNESS)
                ]
                for eta in (ior, 1 / ior)
            ]
            for ior in iors
        ]
    )
    return (
        constant("kGlassCosines", GLASS_MU)
        + constant("kGlassRoughnesses", GLASS_ROUGHNESS)
        + constant("kGlassIors", GLASS_IOR)
        + table(
            "kGlassAlbedo",
            inside,
            "[sqrt((ior - 1) / (ior + 1)), from 0 to sqrt(3 / 5)]"
            "[entering, leaving][roughness][glass_place()][of facets that could refract: reflected;"
            " of others; refracted; what Fresnel reflects of it]",
        )
    )


def sheen_table() -> str:
    step = (1 - SHEEN_SMOOTHEST) / (SHEEN_ROUGHNESS - 1)
    albedo = [
        [sheen(mu_of(m, SHEEN_MU), SHEEN_SMOOTHEST + r * step) for m in range(SHEEN_MU)]
        for r in range(SHEEN_ROUGHNESS)
    ]
    return (
        constant("kSheenCosines", SHEEN_MU)
        + constant("kSheenRoughnesses", SHEEN_ROUGHNESS)
        + f"inline constexpr float kSheenSmoothest = {SHEEN_SMOOTHEST}f;\n"
        + table("kSheenAlbedo", np.array(albedo), "[roughness, from kSheenSmoothest][sqrt(cos)]")
    )


def main(folder: pathlib.Path) -> None:
    files = {
        "core/srgb_table.h": (
            "sRGB bytes as linear numbers.",
            table("kSrgbToLinear", srgb(), "IEC 61966-2-1"),
        ),
        "camera/filter_table.h": (
            "The Blackman-Harris filter.",
            constant("kFilterIntervals", FILTER)
            + table(
                "kInverseBlackmanHarris",
                blackman_harris(),
                "places in [-0.5, 0] by the fourth root of twice the integral",
            ),
        ),
        "bsdf/ggx_tables.h": (
            "Albedos of GGX microfacets (single scattering).",
            reflection_tables() + glass_table(),
        ),
        "bsdf/sheen_tables.h": ("Albedos of sheen.", sheen_table()),
    }
    for name, (what, text) in files.items():
        (folder / name).write_text(HEADER.format(what=what) + text + FOOTER)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
