"""render_data(): one quantity of the path through each pixel's centre, as four floats per pixel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .checks import checked
from .entities import entity
from .motion import motion_vectors
from .pictures import write_picture
from .rendering import flat, shoot
from .session import camera_entity
from .settings import current
from .view import View, view_of

__all__ = ["render_data", "render_data_to_file"]

_SEEDS = 1 << 20  # of the paths of one seed
_FARTHEST = float(np.finfo(np.float32).max)
_LIGHT_PARTS = ("diffuse", "glossy", "transmission")


class Shot(NamedTuple):
    """Frame with the view, time and vertex that it shows."""

    frame: Any
    view: View
    time: float  # of the poses, 0: previous, 1: now
    before: Callable[[], Any] | None = None  # renders the vertex before, for a later one

    def hit(self) -> Any:
        """(H, W) bool: pixels that meet something."""
        return np.isfinite(self.frame["distance"])


class Option(NamedTuple):
    """Option of render_data(). planes: to render for it. values: gives (H, W) or (H, W, 3) of a
    shot."""

    planes: tuple[str, ...]
    values: Callable[[Shot], Any]
    averaged: bool = True  # over the paths of a later vertex; otherwise the first that gets there
    of_samples: bool = False  # of whole paths, so the same at each vertex


@checked
def render_data(
    width: int,
    height: int,
    start_frame: int,
    frame_count: int,
    bounce: int,
    options: str,
    seed: int = 0,
) -> Any:
    """(4 * width * height,) float32, row 0 at the bottom: three channels of the option and 1.

    Light takes frame_count - start_frame samples, at least one. All else is of the path through the
    pixel's centre: of its first surface, or of the vertex after `bounce` scatterings, averaged over
    so many paths that get there; ids are the first such path's.
    """
    samples = max(frame_count - start_frame, 1)
    return flat(_data((width, height), options, samples, (bounce, seed)))


@checked
def render_data_to_file(
    width: int,
    height: int,
    start_frame: int,
    frame_count: int,
    bounce: int,
    options: str,
    file_path: str,
    seed: int = 0,
) -> None:
    """render_data() to .exr or .hdr, or to .png (as colours: sRGB, clamped to [0, 1])."""
    samples = max(frame_count - start_frame, 1)
    write_picture(file_path, _data((width, height), options, samples, (bounce, seed)))


def _data(size: tuple[int, int], name: str, samples: int, which: tuple[int, int]) -> Any:
    """(H, W, 4) float32, row 0 at the top."""
    bounce, seed = which
    if name not in OPTIONS:
        raise RuntimeError(f"options: there is no {name!r}, but {', '.join(OPTIONS)}")
    if bounce < 0:
        raise RuntimeError(f"bounce: {bounce}: is below 0, the first surface")
    option = OPTIONS[name]
    if bounce > 0 and not option.of_samples:
        values = _of_paths(size, option, samples, (bounce, seed))
    else:
        frame = _frame(size, option.planes, spp=samples, seed=seed)
        values = _three(option, _shot(size, frame))
    out = np.ones((*values.shape[:2], 4), "f4")
    out[..., :3] = values
    return out


def _frame(size: tuple[int, int], planes: tuple[str, ...], **options: Any) -> Any:
    interval = current.time_interval
    return shoot(size, list(planes), shutter=interval, label_time=interval[1], **options)


def _shot(size: tuple[int, int], frame: Any, before: Callable[[], Any] | None = None) -> Shot:
    interval = current.time_interval
    return Shot(frame, view_of(camera_entity(), size, interval), interval[1], before)


def _three(option: Option, shot: Shot) -> Any:
    """(H, W, 3) float32."""
    values = np.asarray(option.values(shot), dtype="f4")
    return np.repeat(values[..., None], 3, axis=2) if values.ndim == 2 else values[..., :3]


def _of_paths(size: tuple[int, int], option: Option, paths: int, which: tuple[int, int]) -> Any:
    """(H, W, 3) of a later vertex: mean over the paths that get there; elsewhere the background
    value."""
    bounce, seed = which
    planes = tuple(dict.fromkeys((*option.planes, "distance", "position")))
    total: Any = 0.0
    count: Any = 0
    nothing: Any = None
    for path in range(paths):
        of_path = partial(_frame, size, seed=(seed * _SEEDS + path) % 2**64)
        before = partial(of_path, ("position",), vertex=bounce - 1)
        shot = _shot(size, of_path(planes, vertex=bounce), before)
        values, hit = _three(option, shot), shot.hit()[..., None]
        nothing = values if nothing is None else np.where(hit, nothing, values)
        taken = hit if option.averaged else hit & (count == 0)
        total = total + np.where(taken, values, 0).astype("f8")
        count = count + taken
    return np.where(count > 0, total / np.maximum(count, 1), nothing).astype("f4")


# ---------------------------------------------------------------- the options


def _plane(name: str) -> Option:
    return Option((name,), lambda shot: shot.frame[name])


def _mean(name: str) -> Option:
    return _plane(name)._replace(of_samples=True)


def _or(name: str, background: float) -> Option:
    """Plane, with a value for pixels that meet nothing."""

    def values(shot: Shot) -> Any:
        plane = shot.frame[name]
        hit = shot.hit()
        return np.where(hit if plane.ndim == 2 else hit[..., None], plane, background)

    return Option(tuple(dict.fromkeys((name, "distance"))), values)


def _camera_normal(shot: Shot) -> Any:
    """+X right, +Y up, +Z to the viewer."""
    return shot.frame["normal_camera"] * np.array([1, -1, -1], "f4")


def _entity_id(shot: Shot) -> Any:
    label = shot.frame["instance"]
    return np.where(label > 0, label.astype("f4") - 1, _FARTHEST)


def _texture_coordinates(shot: Shot) -> Any:
    uv = shot.frame["uv"]
    return np.concatenate([uv, np.zeros_like(uv[..., :1])], axis=2)


def _directions(shot: Shot) -> Any:
    """(H, W, 3) float64 unit, world: from the camera through the pixels' centres."""
    k, pose = shot.frame.K, shot.frame.camera_from_world_cv
    height, width = _size(shot)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones(x.shape)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return rays @ np.asarray(pose, dtype=float)[:3, :3]


def _sight(shot: Shot) -> Any:
    """Directions (H, W, 3), unit, world: along the ray that sees; 0 after a later vertex that meets
    nothing."""
    if shot.before is None:
        return _directions(shot)
    way = shot.frame["position"].astype("f8") - shot.before()["position"]
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    return np.where(length > 0, way / np.where(length > 0, length, 1), 0)


def _size(shot: Shot) -> tuple[int, int]:
    return shot.view.camera.height, shot.view.camera.width


def _lit(shot: Shot) -> Any:
    """(H, W, 1) bool: surfaces that are no lights."""
    lights = [e._id + 1 for e in entity._named.values() if e._light is not None]
    return ~np.isin(shot.frame["instance"], lights)[..., None]


def _diffuse_color(shot: Shot) -> Any:
    f = shot.frame
    share = (1 - f["metallic"]) * (1 - f["transmission"])
    return f["base_color"] * share[..., None] * _lit(shot)


def _transmission_color(shot: Shot) -> Any:
    f = shot.frame
    share = (1 - f["metallic"]) * f["transmission"]
    return f["base_color"] * share[..., None] * _lit(shot)


def _glossy_color(shot: Shot) -> Any:
    """Schlick's reflectance at the angle of sight."""
    f = shot.frame
    metallic = f["metallic"][..., None]
    straight = 0.04 * (1 - metallic) + f["base_color"] * metallic
    cosine = np.abs((f["normal"] * _sight(shot)).sum(axis=-1, keepdims=True))
    reflectance = straight + (1 - straight) * (1 - np.clip(cosine, 0, 1)) ** 5
    return np.where(shot.hit()[..., None] & _lit(shot), reflectance, 0)


def _motion(shot: Shot) -> Any:
    return motion_vectors(shot.frame, shot.view, shot.time, _directions(shot))


def _device_id(shot: Shot) -> Any:
    return np.zeros(_size(shot), "f4")


_COLORS = ("base_color", "metallic", "transmission", "instance")

OPTIONS: dict[str, Option] = {
    "none": _mean("beauty"),
    "depth": _or("distance", -_FARTHEST),
    "position": _or("position", -_FARTHEST),
    "normal": _plane("normal"),
    "tangent": _plane("tangent"),
    "screen_space_normal": Option(("normal_camera",), _camera_normal),
    "entity_id": Option(("instance",), _entity_id, averaged=False),
    "base_color": _plane("base_color"),
    "texture_coordinates": Option(("uv",), _texture_coordinates),
    "diffuse_motion_vectors": Option(("position", "instance"), _motion),
    "ray_direction": Option(("distance",), _sight),
    "diffuse_color": Option(_COLORS, _diffuse_color),
    "glossy_color": Option((*_COLORS, "normal", "distance"), _glossy_color),
    "transmission_color": Option(_COLORS, _transmission_color),
    **{
        f"{part}_{path}_lighting": _mean(f"{path}_{part}")
        for part in _LIGHT_PARTS
        for path in ("direct", "indirect")
    },
    "heatmap": Option(
        ("cost",), lambda shot: np.clip(shot.frame["cost"] / 100, 0, 1), of_samples=True
    ),
    "device_id": Option(("distance",), _device_id),
    "denoise_albedo": _mean("albedo_mean"),
    "denoise_normal": _mean("normal_mean"),
}
