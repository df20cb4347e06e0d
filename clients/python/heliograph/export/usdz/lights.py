"""Lights, the dome and cameras to UsdLux and UsdGeomCamera. Needs pxr."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Gf, UsdGeom, UsdLux

from ..._wire.arrays import NdArray
from ...values.components import Camera
from ..lamps import Lamp, irradiance, radiance, shape_extent
from ..looks import picture_of
from ..notes import note_camera, note_lamp
from ..world import Dome, Entity, World
from .materials import NIT
from .meshes import put_strength
from .stage import FRAMES, TOP, Stage, matrix_of

KINDS = {
    **{"sphere": UsdLux.SphereLight, "disc": UsdLux.DiskLight, "rectangle": UsdLux.RectLight},
    "sun": UsdLux.DistantLight,
}
# prim_from_dome of a picture as OpenEXR and UsdLux have it: +Y up, its middle towards +Z.
_OPENEXR = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_FAR = 1e9  # metres: the scene has no far plane
_NEAR = 1e-3  # metres, of cameras that name none
_SENSOR = 0.36  # tenths of a metre: 36 mm
_TENTH = 0.1  # apertures and focal lengths are in tenths of a unit


def put_light(world: World, stage: Stage, path: str, entity: Entity, pose: NdArray) -> Any:
    """The light of a shape, or a sun. pose: (4, 4) world_from_entity."""
    lamp = Lamp(entity.message.light)
    note_lamp(world, entity, lamp)
    light = KINDS[lamp.shape].Define(stage.stage, path)
    light.CreateNormalizeAttr(False)
    if lamp.shape == "sun":
        light.CreateAngleAttr(math.degrees(lamp.message.sun_angle))
        light.CreateNormalizeAttr(True)
        put_strength(light, irradiance(lamp) * NIT)
        return light.GetPrim()
    put_strength(light, radiance(lamp, shape_extent(lamp, pose)) * NIT)
    if lamp.shape == "rectangle":
        light.CreateWidthAttr(lamp.size("width"))
        light.CreateHeightAttr(lamp.size("height"))
    else:
        light.CreateRadiusAttr(lamp.size("radius"))
    if lamp.message.two_sided and lamp.shape != "sphere":
        world.notes.add(entity.title, "its light comes from its front alone")
    if lamp.has_cone:
        _put_cone(light, lamp)
    return light.GetPrim()


def _put_cone(light: Any, lamp: Lamp) -> None:
    shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
    outer, inner = lamp.message.outer_cone_angle, lamp.message.inner_cone_angle
    shaping.CreateShapingConeAngleAttr(math.degrees(outer))
    shaping.CreateShapingConeSoftnessAttr(1 - inner / outer)


def put_portal(stage: Stage, path: str, entity: Entity) -> Any:
    light = UsdLux.PortalLight.Define(stage.stage, path)
    portal = entity.message.portal
    for name in ("width", "height"):
        size = getattr(portal, name) if portal.HasField(name) else 1.0
        getattr(light, f"Create{name.title()}Attr")(size)
    return light.GetPrim()


def put_dome(world: World, stage: Stage, dome: Dome) -> None:
    light = UsdLux.DomeLight.Define(stage.stage, stage.path(TOP, "dome"))
    put_strength(light, dome.color * NIT)
    turn = np.eye(4)
    turn[:3, :3] = dome.rotation @ _OPENEXR.T
    light.AddTransformOp().Set(matrix_of(turn))
    if dome.texture is not None:
        light.CreateTextureFileAttr(stage.picture(picture_of(world, dome.texture)))
        light.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    if not dome.camera_visible:
        world.notes.add("dome", "cameras see it in other programs")


def put_camera(world: World, stage: Stage, path: str, entity: Entity) -> Any:
    """None, and a note: USD has no such camera."""
    camera = Camera.from_message(entity.message.camera)
    if camera.projection not in ("perspective", "orthographic"):
        world.notes.add(entity.title, f"{camera.projection} cameras are left out")
        return None
    note_camera(world, entity, camera)
    out = UsdGeom.Camera.Define(stage.stage, path)
    width, height, focal = _apertures(out, camera)
    out.CreateHorizontalApertureAttr(width)
    out.CreateVerticalApertureAttr(height)
    out.CreateFocalLengthAttr(focal)
    out.CreateHorizontalApertureOffsetAttr(width * (0.5 - (camera.cx + 0.5) / camera.width))
    out.CreateVerticalApertureOffsetAttr(height * ((camera.cy + 0.5) / camera.height - 0.5))
    near, far = camera.near or _NEAR, min(camera.far, _FAR)
    out.CreateClippingRangeAttr(Gf.Vec2f(near, far))
    if camera.aperture:
        out.CreateFStopAttr(_TENTH * focal / camera.aperture)
        out.CreateFocusDistanceAttr(camera.focus_distance)
    if camera.blades:
        world.notes.add(entity.title, "the blades of the lens's aperture are left out")
    if any(camera.shutter):
        out.CreateShutterOpenAttr(camera.shutter[0] * FRAMES)
        out.CreateShutterCloseAttr(camera.shutter[1] * FRAMES)
    return out.GetPrim()


def _apertures(out: Any, camera: Camera) -> tuple[float, float, float]:
    """Width, height and focal length, in tenths of a metre."""
    if camera.projection == "orthographic":
        out.CreateProjectionAttr(UsdGeom.Tokens.orthographic)
        wide, high = camera.width / camera.fx, camera.height / camera.fy
        return wide / _TENTH, high / _TENTH, _SENSOR
    focal = camera.fx * _SENSOR / camera.width
    return _SENSOR, camera.height / camera.fy * focal, focal
