"""render() and render_to_file()."""

from __future__ import annotations

from typing import Any

import numpy as np

from .checks import as_runtime_error, checked
from .pictures import write_picture
from .session import call_back, camera_entity, session
from .settings import current
from .view import view_of

__all__ = [
    "render",
    "render_to_file",
    "render_to_hdr",
    "render_to_png",
]


@checked
def render(width: int, height: int, samples_per_pixel: int, seed: int = 0) -> Any:
    """(4 * width * height,) float32: linear RGBA, row 0 at the bottom."""
    return flat(picture((width, height), samples_per_pixel, seed))


@checked
def render_to_file(
    width: int, height: int, samples_per_pixel: int, file_path: str, seed: int = 0
) -> None:
    """Renders to a .png (sRGB), .exr or .hdr (linear) file."""
    write_picture(file_path, picture((width, height), samples_per_pixel, seed))


def render_to_hdr(
    width: int, height: int, samples_per_pixel: int, image_path: str, seed: int = 0
) -> None:
    """The old name of render_to_file."""
    render_to_file(width, height, samples_per_pixel, image_path, seed)


def render_to_png(
    width: int, height: int, samples_per_pixel: int, image_path: str, seed: int = 0
) -> None:
    """The old name of render_to_file."""
    render_to_file(width, height, samples_per_pixel, image_path, seed)


def flat(rows: Any) -> Any:
    """Row 0 at the top to a flat array with row 0 at the bottom."""
    return np.ascontiguousarray(rows[::-1], dtype="f4").reshape(-1)


def picture(size: tuple[int, int], samples: int, seed: int) -> Any:
    """(H, W, 4) float32, row 0 at the top."""
    name = "denoised" if current.denoise else "beauty"
    frame = shoot(size, [name], spp=samples, seed=seed, shutter=current.time_interval)
    return frame[name]


def shoot(size: tuple[int, int], planes: list[str], shutter: Any, **options: Any) -> Any:
    """Frame of the current state."""
    call_back()
    here = session()
    with as_runtime_error():
        seen = here.mirror.push(view_of(camera_entity(), size, tuple(shutter)))
        if current.direct_clamp:
            options["clamp"] = current.direct_clamp
        if current.indirect_clamp:
            options["clamp_indirect"] = current.indirect_clamp
        options["max_depth"] = 2 + max(current.depths)
        return here.mirror.scene.render(
            seen, planes=planes, size=size, time=0.0, filter="box", labels=False, **options
        )
