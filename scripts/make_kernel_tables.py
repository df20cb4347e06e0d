"""Writes the tables of kernels/: sRGB decoding, the inverse of the Blackman-Harris filter's
integral, and albedos of GGX.

usage: make_kernel_tables.py KERNELS_FOLDER (needs numpy). The results are checked in; run it again
when a size changes.
"""

import pathlib
import sys

import numpy as np

MU, ROUGHNESS = 32, 32  # reflection: cosines (sqrt-spaced), roughnesses
GLASS_MU, GLASS_ROUGHNESS, GLASS_IOR = 16, 16, 16
FILTER = 128  # intervals of one half
GRID = 96  # per side, quadrature points over the sampling square

HEADER = """// {what} Written by scripts/make_kernel_tables.py.
#pragma once

#include "kernels/platform.h"

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


def lambda_ggx(z: np.ndarray, alpha: float) -> np.ndarray:
    z2 = np.minimum(z * z, 1)
    return (np.sqrt(1 + alpha**2 * (1 - z2) / np.maximum(z2, 1e-12)) - 1) / 2


def visible_normals(mu: float, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """wo, and half vectors distributed by GGX's visible normals (Dupuy and Benyoub 2023)."""
    u = (np.arange(GRID) + 0.5) / GRID
    u1, u2 = (a.ravel() for a in np.meshgrid(u, u))
    wo = np.array([np.sqrt(1 - mu * mu), 0.0, mu])
    s = wo * [alpha, alpha, 1]
    s /= np.linalg.norm(s)
    z = (1 - u2) * (1 + s[2]) - s[2]
    r = np.sqrt(np.clip(1 - z * z, 0, 1))
    h = np.stack([r * np.cos(2 * np.pi * u1), r * np.sin(2 * np.pi * u1), z], 1) + s
    h *= [alpha, alpha, 1]
    return wo, h / np.linalg.norm(h, axis=1, keepdims=True)


def reflection(mu: float, alpha: float) -> tuple[float, float]:
    """Albedo of single scattering for Fresnel 1, and the same weighted by (1 - cos)^5."""
    wo, h = visible_normals(mu, alpha)
    c = h @ wo
    wi_z = 2 * c * h[:, 2] - wo[2]
    lo = lambda_ggx(np.array(mu), alpha)
    weight = np.where(wi_z > 0, (1 + lo) / (1 + lo + lambda_ggx(wi_z, alpha)), 0)
    return weight.mean(), (weight * (1 - c) ** 5).mean()


def fresnel(c: np.ndarray, eta: float) -> tuple[np.ndarray, np.ndarray]:
    t2 = 1 - (1 - c * c) / eta**2
    t = np.sqrt(np.maximum(t2, 0))
    parallel = (eta * c - t) / (eta * c + t)
    perpendicular = (c - eta * t) / (c + eta * t)
    return np.where(t2 > 0, (parallel**2 + perpendicular**2) / 2, 1), t


def glass(mu: float, alpha: float, eta: float) -> float:
    """Share of light that leaves a rough interface after one scattering, reflected or refracted."""
    wo, h = visible_normals(mu, alpha)
    c = h @ wo
    f, t = fresnel(c, eta)
    lo = lambda_ggx(np.array(mu), alpha)
    up = 2 * c * h[:, 2] - mu
    down = (c / eta - t) * h[:, 2] - mu / eta
    g_up = (1 + lo) / (1 + lo + lambda_ggx(up, alpha))
    g_down = (1 + lo) / (1 + lo + lambda_ggx(down, alpha))
    return (f * g_up * (up > 0) + (1 - f) * g_down * ((down < 0) & (f < 1))).mean()


def alpha_of(i: int, n: int) -> float:
    return max((i / (n - 1)) ** 2, 1e-4)


def mu_of(i: int, n: int) -> float:
    return max((i / (n - 1)) ** 2, 1e-4)


def ggx_tables() -> str:
    albedo = np.array(
        [
            [reflection(mu_of(m, MU), alpha_of(r, ROUGHNESS)) for m in range(MU)]
            for r in range(ROUGHNESS)
        ]
    )
    # Averages integrate the interpolated table, so that the furnace closes with what kernels read.
    s, w = np.polynomial.legendre.leggauss(400)
    mu = (s + 1) / 2
    grid = np.arange(MU) / (MU - 1)
    average = np.array(
        [
            [np.sum(w * mu * np.interp(np.sqrt(mu), grid, row[:, k])) for k in (0, 1)]
            for row in albedo
        ]
    )
    top = np.sqrt(3 / 5)
    iors = [max((1 + x * x) / (1 - x * x), 1.001) for x in np.linspace(0, top, GLASS_IOR)]
    inside = np.array(
        [
            [
                [
                    [
                        glass(mu_of(m, GLASS_MU), alpha_of(r, GLASS_ROUGHNESS), eta)
                        for m in range(GLASS_MU)
                    ]
                    for r in range(GLASS_ROUGHNESS)
                ]
                for eta in (ior, 1 / ior)
            ]
            for ior in iors
        ]
    )
    return (
        constant("kAlbedoCosines", MU)
        + constant("kAlbedoRoughnesses", ROUGHNESS)
        + table("kReflectionAlbedo", albedo, "[roughness][sqrt(cos)][Fresnel 1, (1 - cos_h)^5]")
        + table(
            "kReflectionAverage",
            average,
            "[roughness][the same two], averaged over the hemisphere by cosine",
        )
        + constant("kGlassCosines", GLASS_MU)
        + constant("kGlassRoughnesses", GLASS_ROUGHNESS)
        + constant("kGlassIors", GLASS_IOR)
        + table(
            "kGlassAlbedo",
            inside,
            "[sqrt((ior - 1) / (ior + 1)), from 0 to sqrt(3 / 5)]"
            "[entering, leaving][roughness][sqrt(cos)]",
        )
    )


def main(folder: pathlib.Path) -> None:
    files = {
        "srgb_table.h": (
            "sRGB bytes as linear numbers.",
            table("kSrgbToLinear", srgb(), "IEC 61966-2-1"),
        ),
        "filter_table.h": (
            "The Blackman-Harris filter.",
            constant("kFilterIntervals", FILTER)
            + table(
                "kInverseBlackmanHarris",
                blackman_harris(),
                "places in [-0.5, 0] by the fourth root of twice the integral",
            ),
        ),
        "ggx_tables.h": ("Albedos of GGX microfacets (single scattering).", ggx_tables()),
    }
    for name, (what, text) in files.items():
        (folder / name).write_text(HEADER.format(what=what) + text + FOOTER)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
