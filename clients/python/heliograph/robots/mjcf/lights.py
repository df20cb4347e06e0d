"""Lights, sky and cameras. Used by building.py; docs/mjcf.md describes how bright they are.

Source: MuJoCo's manual, "XML Reference", body/light, body/camera and visual.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...image.tonemap import decode_srgb
from ...values.components import Camera, Visibility
from ...values.lights import Light
from ...values.pose import look_at
from .cubes import lat_long
from .looks import linear, texels_of
from .reading import camera_at, mujoco, pose

if TYPE_CHECKING:
    from .building import MjcfBuilder

_SUN = 0.0093  # radians
_HALF_SPHERE = 3.139  # radians, about the widest sun
_BULB = 0.02  # metres, where the file has none
_UNSEEN = Visibility(camera=False)


# ------------------------------------------------------------ cameras


def put_cameras(builder: MjcfBuilder, size: tuple[int, int]) -> None:
    model, data = builder.source.model, builder.source.data
    for c, name in enumerate(builder.source.names("camera", model.ncam)):
        lens = _lens(builder, c, name, size)
        if _moves_along(builder, "cam", "camera", c, name):
            parent = builder.link(model.cam_bodyid[c])[0]
            at = pose(model.cam_pos[c], model.cam_quat[c])
        else:
            parent, at = builder.robot.root, camera_at(data, c)
        full = builder.free_name(f"{builder.robot.name}/camera/{name}")
        builder.robot.cameras[name] = builder.edits.entity(
            full, exist_ok=False, parent=parent, transform=at, camera=lens
        )


def _lens(builder: MjcfBuilder, c: int, name: str, size: tuple[int, int]) -> Camera:
    model = builder.source.model
    resolution = model.cam_resolution[c]
    width, height = (int(n) for n in (resolution if resolution.min() > 1 else size))
    near = float(model.vis.map.znear * model.stat.extent)
    fovy = float(model.cam_fovy[c])
    if _is_orthographic(model, c):
        return Camera.orthographic(height / fovy, width, height, near=near)
    if not model.cam_sensorsize[c].all():
        return Camera.from_fov(fovy, width, height, axis="y", degrees=True, near=near)
    fx, fy, cx, cy = model.cam_intrinsic[c] / np.tile(model.cam_sensorsize[c], 2)
    return Camera(
        *(width, height, fx * width, fy * height),
        *((0.5 - cx) * width - 0.5, (0.5 - cy) * height - 0.5),
        near=near,
    )


def _is_orthographic(model: Any, c: int) -> bool:
    if hasattr(model, "cam_projection"):
        return bool(model.cam_projection[c] == mujoco().mjtProjection.mjPROJ_ORTHOGRAPHIC)
    return hasattr(model, "cam_orthographic") and bool(model.cam_orthographic[c])


def _moves_along(builder: MjcfBuilder, prefix: str, kind: str, index: int, name: str) -> bool:
    """True for a camera or light that is fixed to its body; warns of others."""
    modes = mujoco().mjtCamLight
    mode = modes(int(getattr(builder.source.model, f"{prefix}_mode")[index]))
    if mode == modes.mjCAMLIGHT_FIXED:
        return True
    what = mode.name.removeprefix("mjCAMLIGHT_").lower()
    builder.robot.warnings.append(
        f"{kind} {name!r} has mode {what}: it stays where it is at qpos0"
        + ("; move it by camera_pose()" if kind == "camera" else "")
    )
    return False


# ------------------------------------------------------------ lights


def put_lights(builder: MjcfBuilder) -> None:
    model = builder.source.model
    for i, name in enumerate(builder.source.names("light", model.nlight)):
        if model.light_active[i]:
            _put_light(builder, i, name)
    _put_ambient(builder)
    _put_sky(builder)


def _put_light(builder: MjcfBuilder, i: int, name: str) -> None:
    model, data = builder.source.model, builder.source.data
    light = _light(builder, i)
    if light is None:
        builder.robot.warnings.append(f"light {name!r} is left out: it is a picture; give a dome")
        return
    if _moves_along(builder, "light", "light", i, name):
        parent = builder.link(model.light_bodyid[i])[0]
        at = look_at(model.light_pos[i], model.light_pos[i] + model.light_dir[i])
    else:
        parent = builder.robot.root
        at = look_at(data.light_xpos[i], data.light_xpos[i] + data.light_xdir[i])
    full = builder.free_name(f"{builder.robot.name}/light/{name}")
    builder.robot.lights[name] = builder.edits.entity(
        full, exist_ok=False, parent=parent, transform=at, light=light, visibility=_UNSEEN
    )


def _light(builder: MjcfBuilder, i: int) -> Light | None:
    """None: of a kind that we do not have."""
    model = builder.source.model
    kind = _kind_of(model, i)
    color = linear(model.light_diffuse[i])
    if kind == "directional":
        return Light(irradiance=math.pi, color=color, sun_angle=_SUN)
    if kind not in ("spot", "point"):
        return None
    bulb = float(model.light_bulbradius[i]) if hasattr(model, "light_bulbradius") else _BULB
    given: dict[str, Any] = {"shape": "sphere", "radius": bulb or _BULB, "color": color}
    cutoff = math.radians(float(model.light_cutoff[i]))
    if kind == "spot" and 0 < cutoff <= 0.5 * math.pi + 1e-6:
        is_sharp = model.light_exponent[i] == 0
        given["outer_cone_angle"] = min(cutoff, 0.5 * math.pi)
        given["inner_cone_angle"] = given["outer_cone_angle"] if is_sharp else 0.0
    candela = float(model.light_intensity[i]) if hasattr(model, "light_intensity") else 0.0
    if candela > 0:
        return Light(candela=candela, **given)
    return Light(intensity=_intensity(builder, i), **given)


def _kind_of(model: Any, i: int) -> str:
    if not hasattr(model, "light_type"):
        return "directional" if model.light_directional[i] else "spot"
    kinds = mujoco().mjtLightType
    return str(kinds(int(model.light_type[i])).name).removeprefix("mjLIGHT_").lower()


def _intensity(builder: MjcfBuilder, i: int) -> float:
    """W/sr of a light that gives the middle of the model what MuJoCo gives it there: pi for white,
    by which white is shown white."""
    model, data = builder.source.model, builder.source.data
    distance = float(np.linalg.norm(data.light_xpos[i] - model.stat.center))
    fall = float(model.light_attenuation[i] @ (1.0, distance, distance**2))
    return math.pi * distance**2 / max(fall, 1e-9)


def _put_ambient(builder: MjcfBuilder) -> None:
    """Light from all sides: two suns as wide as half a sphere, which no camera sees."""
    model, head = builder.source.model, builder.source.model.vis.headlight
    color = np.zeros(3)
    for i in np.flatnonzero(model.light_active):
        color += linear(model.light_ambient[i])
    if head.active:
        color += linear(head.ambient + head.diffuse)
    if not color.any():
        return
    light = Light(irradiance=math.pi, color=color, sun_angle=_HALF_SPHERE)
    for name, towards in (("ambient_above", -1.0), ("ambient_below", 1.0)):
        full = builder.free_name(f"{builder.robot.name}/light/{name}")
        builder.robot.lights[name] = builder.edits.entity(
            full,
            exist_ok=False,
            parent=builder.robot.root,
            transform=look_at((0, 0, 0), (0, 0, towards)),
            light=light,
            visibility=_UNSEEN,
        )


def _put_sky(builder: MjcfBuilder) -> None:
    model = builder.source.model
    skies = np.flatnonzero(model.tex_type == mujoco().mjtTexture.mjTEXTURE_SKYBOX)
    if len(skies):
        builder.edits.dome(_sky(model, int(skies[0])))


def _sky(model: Any, texture: int) -> NdArray:
    """(H, W, 3) float16, lat-long. MuJoCo turns the cube by a quarter about x."""
    texels = texels_of(model, texture)[..., :3]
    found = lat_long(texels, lambda d: np.stack([d[..., 0], d[..., 2], -d[..., 1]], axis=-1))
    return np.asarray(decode_srgb(np.arange(256) / 255).astype("f2")[found])
