"""The picture of docs/cameras.md, section Sensors: what a camera and two depth cameras report,
and a mosaic.

usage: sensors.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from cameras import EYE, TARGET, build

SIZE = (320, 240)
NEAR, FAR = 1.5, 11.0

RGB = hg.RgbSensor(
    exposure=-3, full_well=900, read_noise=4, black_level=0.02, bits=10, vignetting=1
)
STEREO = hg.DepthSensor(
    baseline=0.09,
    **{"disparity_noise": 0.17, "disparity_step": 0.125, "lateral_noise": 0.5, "window": 5},
    min_signal=2e-4,
    max_angle=1.5,
)
MOSAIC = hg.RgbSensor(full_well=2000, read_noise=3, bits=12, pattern="rggb")
PART = (slice(80, 140), slice(120, 200))  # of the mosaic, rows and columns
FLIGHT = hg.DepthSensor("time_of_flight", range_noise=0.002, window=3, min_signal=2e-4)


def shade(depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: near bright, far dark, no measurement blue."""
    seen = np.isfinite(depth) & (depth > 0)
    grey = 255 * (1 - np.clip((np.where(seen, depth, FAR) - NEAR) / (FAR - NEAR), 0, 1))
    out = np.repeat(grey[..., None], 3, axis=2)
    out[~seen] = (20, 40, 110)
    return out.astype("u1")


def colored(mosaic: np.ndarray) -> np.ndarray:
    """(H, W, 3): each photosite of an RGGB mosaic in its own colour."""
    out = np.zeros((*mosaic.shape, 3), mosaic.dtype)
    for channel, y, x in ((0, 0, 0), (1, 0, 1), (1, 1, 0), (2, 1, 1)):
        out[y::2, x::2, channel] = mosaic[y::2, x::2]
    return out


def main(out: Path, spp: int) -> None:
    from heliograph import tonemap
    from PIL import Image

    pose = hg.look_at(EYE, TARGET, (0, 0, 1))
    with hg.connect() as client, client.create_scene("sensors") as scene:
        with scene.edit() as edit:
            build(edit)
            for name, depth in (("stereo", STEREO), ("flight", FLIGHT)):
                lens = hg.Camera.from_fov(
                    *(55, *SIZE), degrees=True, rgb_sensor=RGB, depth_sensor=depth
                )
                edit.entity(name, camera=lens, transform=pose)
        frame = scene.render("stereo", planes=["sensor_rgb", "sensor_depth", "depth"], spp=spp)
        flight = scene.render("flight", planes=["sensor_depth"])
        with scene.edit() as edit:
            lens = hg.Camera.from_fov(55, *SIZE, degrees=True, rgb_sensor=MOSAIC)
            edit.entity("mosaic", camera=lens, transform=pose)
        raw = scene.render("mosaic", planes=["sensor_mosaic", "sensor_rgb"], spp=spp)
    rgb = tonemap.to_srgb8(4 * (frame["sensor_rgb"] - RGB.black_level).clip(0), 0.0, "standard")
    depths = [shade(d) for d in (frame["depth"], frame["sensor_depth"], flight["sensor_depth"])]
    parts = [colored(raw["sensor_mosaic"])[PART], raw["sensor_rgb"][PART]]
    parts = [tonemap.to_srgb8(part.repeat(4, 0).repeat(4, 1), 0.0, "standard") for part in parts]
    rows = [np.concatenate(row, axis=1) for row in ([rgb, depths[0]], depths[1:], parts)]
    picture = Image.fromarray(np.concatenate(rows))
    picture.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 128)
