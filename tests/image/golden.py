"""Golden images: mean and variance of each scene, and the tests a new render must pass."""

from __future__ import annotations

import math
import pathlib
from dataclasses import dataclass

import numpy as np

FOLDER = pathlib.Path(__file__).parent / "golden"
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
LEVEL = 0.01  # of each image's family of pixel tests, and of the test of its mean
PASSING = 0.9975  # share of pixels that must pass: heavy tails are not normal at few samples


@dataclass
class Verdict:
    """How a render compares: p-value of the mean, share of pixels within the corrected level."""

    mean_p: float
    passing: float

    @property
    def ok(self) -> bool:
        return self.mean_p >= LEVEL and self.passing >= PASSING


def path(name: str) -> pathlib.Path:
    return FOLDER / f"{name}.npz"


def save(name: str, mean: np.ndarray, variance: np.ndarray) -> None:
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(path(name), mean=mean.astype("f4"), variance=variance.astype("f4"))


def load(name: str) -> tuple[np.ndarray, np.ndarray]:
    with np.load(path(name)) as data:
        return data["mean"], data["variance"]


def normal_p(z: np.ndarray) -> np.ndarray:
    """Two-sided p-value of a standard normal."""
    return np.vectorize(lambda x: math.erfc(abs(x) / math.sqrt(2)))(z)


def compare(
    image: np.ndarray, variance: np.ndarray, golden: tuple[np.ndarray, np.ndarray]
) -> Verdict:
    """A z-test of each pixel's luminance with Sidak's correction, and one of the image's mean.

    After the image tests of Mitsuba 3; the mean is ours: it finds faint biases below the noise."""
    mean, golden_variance = golden
    difference = (image - mean) @ LUMINANCE
    total = variance + golden_variance
    z = difference / np.sqrt(np.maximum(total, 1e-12))
    per_pixel = 1 - (1 - LEVEL) ** (1 / z.size)
    passing = float((normal_p(z) >= per_pixel).mean())
    mean_z = difference.mean() / math.sqrt(total.mean() / total.size)
    return Verdict(float(normal_p(np.array(mean_z))), passing)
