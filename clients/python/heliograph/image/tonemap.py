"""Scene-linear radiance to 8-bit sRGB: exposure and view transforms. Used by Frame.image()."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument

VIEWS = ("standard", "filmic", "agx")


def auto_exposure(rgb: NdArray, weight: NdArray) -> float:
    """Stops that bring the middle of a picture to a good brightness.

    rgb: (H, W, 3) radiance. weight: (H, W), 0 where a pixel does not count (background).
    The geometric mean goes to 0.18 (Reinhard et al. 2002, eq. 1), but no more than 2 % of the
    counted pixels may be brighter than 1.6 afterwards.
    """
    luminance = rgb.astype("f4") @ np.array([0.2126, 0.7152, 0.0722], dtype="f4")
    counted = luminance[(weight > 0.5) & np.isfinite(luminance) & (luminance > 1e-6)]
    if counted.size == 0:
        return 0.0
    middle = 0.18 / float(np.exp(np.mean(np.log(counted))))
    ceiling = 1.6 / float(np.quantile(counted, 0.98))
    return float(np.clip(np.log2(min(middle, ceiling)), -16, 16))


def to_srgb8(rgb: NdArray, exposure: float, view: str) -> NdArray:
    """(H, W, 3) uint8 of (H, W, 3) radiance; rounded."""
    if view not in VIEWS:
        raise InvalidArgument(f"view: one of {', '.join(VIEWS)}, not {view!r}", field="view")
    linear = np.nan_to_num(rgb.astype("f4") * np.float32(2.0**exposure), posinf=1e6, neginf=0)
    linear = np.maximum(linear, 0)
    encoded = {"standard": encode_srgb, "filmic": _filmic, "agx": _agx}[view](linear)
    return np.asarray((np.clip(encoded, 0, 1) * 255 + 0.5).astype(np.uint8))


def encode_srgb(linear: NdArray) -> NdArray:
    """IEC 61966-2-1."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)


def decode_srgb(encoded: NdArray) -> NdArray:
    """Linear Rec.709 of sRGB in [0, 1]; IEC 61966-2-1."""
    x = np.clip(encoded, 0, 1)
    return np.asarray(np.where(x <= 0.04045, x / 12.92, np.power((x + 0.055) / 1.055, 2.4)))


def _filmic(linear: NdArray) -> NdArray:
    """The rational fit of Narkowicz 2016, "ACES Filmic Tone Mapping Curve", times 0.6."""
    x = 0.6 * linear
    return encode_srgb(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14))


_AGX_IN = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ]
)
_AGX_OUT = np.linalg.inv(_AGX_IN)


def _agx(linear: NdArray) -> NdArray:
    """AgX (T. Sobotka) with the polynomial fit of B. Wrensch 2023, "Minimal AgX Implementation"."""
    x = np.log2(np.maximum(linear @ _AGX_IN.T, 1e-10))
    x = np.clip((x + 12.47393) / (4.026069 + 12.47393), 0, 1)
    x2 = x * x
    x4 = x2 * x2
    y = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x
    y = y + 0.4298 * x2 + 0.1191 * x - 0.00232
    return np.asarray(np.clip(y, 0, None) @ _AGX_OUT.T)


def colors_of_ids(ids: NdArray) -> NdArray:
    """(H, W, 3) uint8: a distinct colour for each id; 0 and 0xffffffff are black."""
    hashed = (ids.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    hue = (hashed % np.uint64(4096)).astype("f4") / 4096
    value = 0.65 + 0.35 * ((hashed >> np.uint64(12)) % np.uint64(8)).astype("f4") / 7
    wheel = np.abs((hue[..., None] * 6 + np.array([0, 4, 2])) % 6 - 3) - 1
    rgb = value[..., None] * (0.35 + 0.65 * np.clip(wheel, 0, 1))
    rgb[(ids == 0) | (ids == 0xFFFFFFFF)] = 0
    return np.asarray((rgb * 255 + 0.5).astype(np.uint8))


def grey_of(values: Any) -> NdArray:
    """(H, W) uint8: near bright, far dark, over the finite range of `values`; else black."""
    values = np.asarray(values, dtype="f4")
    finite = np.isfinite(values)
    if not finite.any():
        return np.zeros(values.shape, dtype=np.uint8)
    low, high = float(values[finite].min()), float(values[finite].max())
    scaled = 1 - 0.85 * (np.where(finite, values, high) - low) / max(high - low, 1e-9)
    return np.where(finite, scaled * 255 + 0.5, 0).astype(np.uint8)


# Hues between neighbouring anchors of the flow wheel, and the anchors.
_WHEEL = (15, 6, 4, 11, 13, 6)
_ANCHORS = np.array(
    [[1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1], [1, 0, 1], [1, 0, 0]], dtype="f4"
)


def colors_of_flow(flow: NdArray, reach: float | None = None) -> NdArray:
    """(H, W, 3) uint8 of (H, W, 2) pixels: hue is the direction, white is still; nan is black.

    reach: the length that has full colour, default the longest. Source: Baker et al. 2011, "A
    Database and Evaluation Methodology for Optical Flow", IJCV 92, and its colour code of 55 hues.
    """
    known = np.asarray(np.all(np.isfinite(flow), axis=-1))
    u, v = (np.where(known, flow[..., i], 0).astype("f4") for i in (0, 1))
    length = np.hypot(u, v)
    length = length / max(float(length.max()) if reach is None else reach, 1e-9)
    starts = np.cumsum([0, *_WHEEL])
    hue = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (starts[-1] - 1)
    pure = np.stack([np.interp(hue, starts, _ANCHORS[:, c]) for c in range(3)], axis=-1)
    inside = length[..., None] <= 1 + 1e-6
    rgb = np.where(inside, 1 - length[..., None] * (1 - pure), 0.75 * pure)
    return np.asarray((np.where(known[..., None], rgb, 0) * 255 + 0.5).astype(np.uint8))
