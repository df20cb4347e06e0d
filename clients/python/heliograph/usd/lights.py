"""UsdLux to hg.Light, hg.Portal and the dome. Needs pxr.

UsdLux gives the luminance of what emits, in cd/m^2: L = intensity 2^exposure, divided by the area
in the stage's units where `normalize` is set; a nit is context.options.nit W sr^-1 m^-2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdLux

from .._wire.arrays import NdArray
from ..values.lights import Light, Portal
from .context import Context
from .model import Dome, Look, Node
from .networks import plain

_SEGMENTS = 48
_SMALL = 1e-4  # radians: a sun is no smaller
# Frames of a dome's picture: prim_from_dome, where ours has +Z up and its middle towards +X. That
# of OpenEXR, which UsdLux takes, has +Y up and its middle towards +Z.
_OPENEXR = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def put(context: Context, node: Node, prim: Any) -> None:
    """The light of a prim, of its mesh too."""
    kind = str(prim.GetTypeName())
    if kind in ("DomeLight", "DomeLight_1"):
        _put_dome(context, prim)
    elif kind == "PortalLight":
        node.rest["portal"] = Portal(_size(context, prim, "width"), _size(context, prim, "height"))
    elif kind in _KINDS:
        _KINDS[kind](context, node, prim)
        _note_rest(context, prim)
    elif prim.HasAPI(UsdLux.MeshLightAPI):
        node.rest["light"] = Light(radiance=_radiance(context, prim, 1.0), **_color(context, prim))
        if context.value(prim.GetAttribute("inputs:normalize")):
            context.note(prim, "normalize of a mesh's light is left out")
        _note_rest(context, prim)
    elif prim.HasAPI(UsdLux.LightAPI):
        context.note(prim, f"{kind or 'a light without a type'} is left out")


# ---------------------------------------------------------------- strength


def _number(context: Context, prim: Any, name: str, default: float) -> float:
    return context.number(prim.GetAttribute(f"inputs:{name}"), default)


def _size(context: Context, prim: Any, name: str, default: float = 1.0) -> float:
    """Size of a shape in its own units, clamped to [2e-6, 1e6], which the daemon takes."""
    return min(max(_number(context, prim, name, default), 2e-6), 1e6)


def _level(context: Context, prim: Any) -> float:
    """intensity 2^exposure."""
    exposure = _number(context, prim, "exposure", 0.0)
    return float(max(_number(context, prim, "intensity", 1.0), 0.0) * 2.0**exposure)


def _radiance(context: Context, prim: Any, area: float) -> float:
    """Radiance, W sr^-1 m^-2; area: of the emitter, in the stage's units."""
    normalized = bool(context.value(prim.GetAttribute("inputs:normalize")))
    level = _level(context, prim) * context.options.nit
    return level / max(area, 1e-12) if normalized else level


def _color(context: Context, prim: Any) -> dict[str, Any]:
    color = context.value(prim.GetAttribute("inputs:color"))
    found: dict[str, Any] = {
        "color": (1.0, 1.0, 1.0) if color is None else plain(np.maximum(color, 0))
    }
    if context.value(prim.GetAttribute("inputs:enableColorTemperature")):
        kelvin = _number(context, prim, "colorTemperature", 6500.0)
        found["temperature"] = min(max(kelvin, 1000.0), 40000.0)
    return found


def _scales(context: Context, prim: Any) -> NdArray:
    """(3,) how long the prim's axes are in the stage's units."""
    matrix = np.array(UsdGeom.XformCache(context.time).GetLocalToWorldTransform(prim)).T
    return np.asarray(np.linalg.norm(matrix[:3, :3], axis=0))


# ---------------------------------------------------------------- shapes


def _put(context: Context, node: Node, prim: Any, area: float, **shape: Any) -> None:
    given = {**_color(context, prim), **_cone(context, prim), **shape}
    node.rest["light"] = Light(radiance=_radiance(context, prim, area), **given)


def _cone(context: Context, prim: Any) -> dict[str, float]:
    """shaping:cone: half angle, and the share of it over which the edge is soft."""
    if not prim.HasAPI(UsdLux.ShapingAPI):
        return {}
    angle = math.radians(_number(context, prim, "shaping:cone:angle", 90.0))
    if not 1e-3 <= angle < math.pi / 2:
        return {}
    soft = min(max(_number(context, prim, "shaping:cone:softness", 0.0), 0.0), 1.0)
    return {"outer_cone_angle": angle, "inner_cone_angle": angle * (1 - soft) * (1 - 1e-6)}


def _sphere(context: Context, node: Node, prim: Any) -> None:
    radius = _size(context, prim, "radius", 0.5)
    scale = float(np.cbrt(np.prod(_scales(context, prim))))
    _put(context, node, prim, 4 * math.pi * (radius * scale) ** 2, shape="sphere", radius=radius)


def _disk(context: Context, node: Node, prim: Any) -> None:
    radius = _size(context, prim, "radius", 0.5)
    x, y, _ = _scales(context, prim)
    _put(context, node, prim, math.pi * radius**2 * x * y, shape="disc", radius=radius)


def _rect(context: Context, node: Node, prim: Any) -> None:
    width, height = (_size(context, prim, name) for name in ("width", "height"))
    x, y, _ = _scales(context, prim)
    area = width * height * x * y
    _put(context, node, prim, area, shape="rectangle", width=width, height=height)
    texture = context.value(prim.GetAttribute("inputs:texture:file"))
    if texture and texture.path:
        context.note(prim, "the texture of a RectLight is left out")


def _cylinder(context: Context, node: Node, prim: Any) -> None:
    """A tube along X that shines from its side, as a mesh."""
    radius, length = _size(context, prim, "radius", 0.5), _size(context, prim, "length")
    x, y, _ = _scales(context, prim)
    area = 2 * math.pi * radius * y * length * x
    radiance = _radiance(context, prim, area)
    node.rest["light"] = Light(radiance=radiance, **_color(context, prim))
    node.mesh, node.looks = node.path, ["lights/black"]
    context.model.meshes[node.path] = _tube(radius, length)
    black = Look({"base_color": 0.0, "specular": 0.0, "roughness": 1.0})
    context.model.looks.setdefault("lights/black", black)


def _tube(radius: float, length: float) -> Any:
    angle = 2 * math.pi * np.arange(_SEGMENTS) / _SEGMENTS
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ends = [np.column_stack([np.full(_SEGMENTS, x), ring]) for x in (-length / 2, length / 2)]
    a, b = np.arange(_SEGMENTS), (np.arange(_SEGMENTS) + 1) % _SEGMENTS
    c, d = b + _SEGMENTS, a + _SEGMENTS
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return {"positions": np.concatenate(ends).astype("f4"), "indices": faces.astype("<u4")}


def _distant(context: Context, node: Node, prim: Any) -> None:
    """A sun: its irradiance is L pi sin^2(angle / 2), or L itself where `normalize` is set."""
    angle = math.radians(_number(context, prim, "angle", 0.53))
    strength = _level(context, prim) * context.options.nit
    normalized = bool(context.value(prim.GetAttribute("inputs:normalize")))
    if angle > 0 and not normalized:
        strength *= math.pi * math.sin(0.5 * min(angle, math.pi)) ** 2
    node.rest["light"] = Light(
        irradiance=strength, sun_angle=min(max(angle, _SMALL), 3.14), **_color(context, prim)
    )


_KINDS: dict[str, Callable[[Context, Node, Any], None]] = {
    "SphereLight": _sphere,
    "DiskLight": _disk,
    "RectLight": _rect,
    "CylinderLight": _cylinder,
    "DistantLight": _distant,
}


# ---------------------------------------------------------------- the dome


def _put_dome(context: Context, prim: Any) -> None:
    if context.model.dome is not None:
        context.note(prim, "a scene has one dome: this one is left out")
        return
    if UsdGeom.Imageable(prim).ComputeVisibility(context.time) == UsdGeom.Tokens.invisible:
        return
    light = _color(context, prim)
    if light.pop("temperature", None) is not None:
        context.note(prim, "the colour temperature of a dome is left out")
    options = {"color": light["color"], "intensity": _level(context, prim) * context.options.nit}
    context.model.dome = Dome(_picture(context, prim), options, _dome_rotation(context, prim))
    _note_rest(context, prim)


def _picture(context: Context, prim: Any) -> Any:
    texture = context.value(prim.GetAttribute("inputs:texture:file"))
    if not texture or not texture.path:
        return None
    layout = context.value(prim.GetAttribute("inputs:texture:format"))
    if layout not in (None, "automatic", "latlong"):
        context.note(prim, f"a dome's picture with the layout {layout} is left out")
        return None
    found, why = context.files.found(texture.path, texture.resolvedPath)
    if found is None:
        context.note(prim, f"a dome's picture is left out: {why}")
    return found


def _dome_rotation(context: Context, prim: Any) -> NdArray:
    """(3, 3) root_from_dome: of a matrix with scale the rotation next to it."""
    pole = context.value(prim.GetAttribute("poleAxis")) or "Y"
    is_up = pole == "Z" or (pole == "scene" and context.model.up == "z")
    u, _, v = np.linalg.svd(context.world(prim)[:3, :3])
    turn = u @ v
    return np.asarray(turn if is_up else turn @ _OPENEXR)


def _note_rest(context: Context, prim: Any) -> None:
    """Notes the properties of a light that are not read."""
    for name, default in (("diffuse", 1.0), ("specular", 1.0), ("shaping:focus", 0.0)):
        if _number(context, prim, name, default) != default:
            context.note(prim, f"inputs:{name} of lights is left out")
    for name in ("shaping:ies:file", "shaping:cone:softness"):
        found = context.value(prim.GetAttribute(f"inputs:{name}"))
        if name.endswith("file") and found and found.path:
            context.note(prim, "shaping:ies is left out: give the entity hg.Light(profile=)")
    if context.value(prim.GetAttribute("inputs:shadow:enable")) is False:
        context.note(prim, "a light without shadows casts them here")
    for attribute in prim.GetAttributes():
        if attribute.GetNumTimeSamples() > 1 and attribute.GetName().startswith("inputs:"):
            context.note(prim, f"{attribute.GetName()} changes, and is taken as at one time")
    if prim.GetRelationship("light:filters").GetTargets():
        context.note(prim, "filters of lights are left out")
