"""Writes the tables of kernels/: sRGB decoding, the inverse of the Blackman-Harris filter's
integral, albedos of sheen, colours of wavelengths. make_ggx_tables.cpp writes the tables of GGX.

usage: make_kernel_tables.py KERNELS_FOLDER (needs numpy). The results are checked in; run it again
when a size changes.
"""

import pathlib
import sys

import numpy as np

FILTER = 128  # intervals of one half
SHEEN_MU, SHEEN_ROUGHNESS = 64, 16
SHEEN_SMOOTHEST = 0.25  # below, the model reflects more than it gets
SHEEN_GRID = 384  # per side, quadrature points over the hemisphere
SHORTEST, LONGEST = 420, 670  # nm
SPECTRUM_STEPS = 64

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
    u = (np.arange(SHEEN_GRID) + 0.5) / SHEEN_GRID
    z, phi = np.meshgrid(u, u * np.pi)
    sine = np.sqrt(1 - z * z)
    wo = np.array([np.sqrt(1 - mu * mu), 0, mu])
    h = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], -1) + wo
    h_z = h[..., 2] / np.linalg.norm(h, axis=-1)
    density = (2 + 1 / alpha) * (1 - h_z**2) ** (0.5 / alpha) / (2 * np.pi)
    masking = 1 / (1 + sheen_lambda(z, alpha) + sheen_lambda(np.array(mu), alpha))
    return (density * masking).mean() * 2 * np.pi / (4 * mu)


def mu_of(i: int, n: int) -> float:
    return max((i / (n - 1)) ** 2, 1e-4)


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


def lobe(wavelength: np.ndarray, peak: float, below: float, above: float) -> np.ndarray:
    return np.exp(-0.5 * ((wavelength - peak) / np.where(wavelength < peak, below, above)) ** 2)


def linear_srgb(nm: np.ndarray) -> np.ndarray:
    """Colours of single wavelengths (3, n), those outside sRGB at its border.

    Source: Wyman, Sloan and Shirley 2013, "Simple Analytic Approximations to the CIE XYZ Color
    Matching Functions", JCGT 2(2), section 2.2; IEC 61966-2-1.
    """
    x = 1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7)
    x -= 0.065 * lobe(nm, 501.1, 20.4, 26.2)
    y = 0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1)
    z = 1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8)
    xyz_to_rgb = np.array(
        [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    )
    return np.maximum(xyz_to_rgb @ np.stack([x, y, z]), 0)


def spectrum_table() -> str:
    nm = np.linspace(SHORTEST, LONGEST, 30001)
    rgb = linear_srgb(nm)
    rgb /= rgb.mean(1, keepdims=True)
    chosen = np.cumsum(rgb.mean(0))
    chosen = (chosen - chosen[0]) / (chosen[-1] - chosen[0])
    u = np.linspace(0, 1, SPECTRUM_STEPS + 1)
    place = np.interp(u, chosen, nm)
    color = np.stack([np.interp(place, nm, channel) for channel in rgb / rgb.mean(0)])
    for _ in range(100):  # each colour averages 1, the three of a wavelength sum to 3
        color /= np.trapezoid(color, u, axis=1)[:, None]
        color *= 3 / color.sum(0)
    names = ("kSpectrumRed", "kSpectrumGreen", "kSpectrumBlue")
    return (
        constant("kSpectrumSteps", SPECTRUM_STEPS)
        + table("kSpectrumBend", 523655 / place**2 - 1.5168, "[u], see dispersed_ior()")
        + "".join(table(name, row, "[u], of light") for name, row in zip(names, color, strict=True))
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
        "bsdf/sheen_tables.h": ("Albedos of sheen.", sheen_table()),
        "bsdf/spectrum_table.h": (
            "Wavelengths by how much of three colours they hold.",
            spectrum_table(),
        ),
    }
    for name, (what, text) in files.items():
        (folder / name).write_text(HEADER.format(what=what) + text + FOOTER)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
