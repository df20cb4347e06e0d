"""Writes the tables of kernels/: sRGB decoding, the inverse of the Blackman-Harris filter's
integral, and albedos of sheen. make_ggx_tables.cpp writes the tables of GGX.

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
    }
    for name, (what, text) in files.items():
        (folder / name).write_text(HEADER.format(what=what) + text + FOOTER)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
