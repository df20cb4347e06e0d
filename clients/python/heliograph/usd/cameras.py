"""UsdGeomCamera to hg.Camera. Needs pxr."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import UsdGeom

from ..values.components import Camera
from .context import Context
from .model import Node

_FAR = 1e9  # metres: nothing is farther
_TENTH = 0.1  # apertures and focal lengths are in tenths of a unit


def put(context: Context, node: Node, prim: Any) -> None:
    """The camera of a prim; the image's height follows from its apertures."""
    camera = UsdGeom.Camera(prim)
    unit = float(np.cbrt(abs(np.linalg.det(context.world(prim)[:3, :3]))))
    wide = context.number(camera.GetHorizontalApertureAttr(), 20.955)
    high = context.number(camera.GetVerticalApertureAttr(), 15.2908)
    focal = context.number(camera.GetFocalLengthAttr(), 50.0)
    if min(wide, high, focal) <= 0:
        context.note(prim, "a camera without an aperture or a focal length is left out")
        return
    _note_motion(context, camera)
    width = context.options.camera_width
    height = max(1, round(width * high / wide))
    right = context.number(camera.GetHorizontalApertureOffsetAttr()) / wide
    up = context.number(camera.GetVerticalApertureOffsetAttr()) / high
    given: dict[str, Any] = {
        "width": width,
        "height": height,
        "cx": width * (0.5 - right) - 0.5,
        "cy": height * (0.5 + up) - 0.5,
        **_lens(context, camera, unit),
    }
    pixels = width / wide
    if context.value(camera.GetProjectionAttr()) == UsdGeom.Tokens.orthographic:
        scale = pixels / (_TENTH * unit)
        given.update(projection="orthographic", fx=scale, fy=scale)
    else:
        given.update(fx=focal * pixels, fy=focal * pixels)
    node.rest["camera"] = Camera(**given)


def _lens(context: Context, camera: Any, unit: float) -> dict[str, Any]:
    """Clipping, aperture and focus, metres."""
    near, far = context.value(camera.GetClippingRangeAttr()) or (1.0, 1e6)
    near, far = max(near * unit, 0.0), far * unit
    found: dict[str, Any] = {"near": near, "far": far if near < far < _FAR else math.inf}
    stop = context.number(camera.GetFStopAttr())
    focus = context.number(camera.GetFocusDistanceAttr())
    if stop > 0 and focus > 0:
        focal = context.number(camera.GetFocalLengthAttr(), 50.0)
        found["aperture"] = min(_TENTH * unit * focal / stop, 1e3)
        found["focus_distance"] = min(max(focus * unit, 1e-6), _FAR)
    opens = context.number(camera.GetShutterOpenAttr())
    closes = context.number(camera.GetShutterCloseAttr())
    if closes > opens:
        found["shutter"] = (context.seconds(opens), context.seconds(closes))
    return found


def _note_motion(context: Context, camera: Any) -> None:
    for attribute in camera.GetPrim().GetAttributes():
        name = attribute.GetName()
        if attribute.GetNumTimeSamples() > 1 and not name.startswith("xformOp"):
            context.note(camera, f"{name} changes, and is taken as at one time")
    if len(context.value(camera.GetClippingPlanesAttr()) or ()):
        context.note(camera, "clippingPlanes are left out; clippingRange counts")
