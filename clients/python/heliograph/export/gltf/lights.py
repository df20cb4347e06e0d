"""Lights and cameras of glTF. Source: KHR_lights_punctual; glTF 2.0, 3.10."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..._wire._proto import scene_pb2 as pb
from ..._wire.arrays import NdArray
from ...values.components import Camera
from ...values.shapes import sphere
from ..lamps import LUMENS_PER_WATT, Lamp, irradiance, radiance, shape_extent
from ..notes import note_camera, note_lamp
from ..world import Entity, World
from .document import INDICES, VERTICES, Document

_POINT = 0.02  # metres: smaller spheres are points
_NEAR, _FAR = 0.01, 1e4  # metres, of cameras that name none
_SEGMENTS = 64
LIGHTS = "KHR_lights_punctual"


class Lights:
    """Puts lights, and meshes of lights with an extent, into a document."""

    def __init__(self, world: World, document: Document) -> None:
        self.world = world
        self.document = document
        self._shapes: dict[str, tuple[dict[str, int], int]] = {}

    def put(self, node: dict[str, Any], entity: Entity, world: NdArray) -> dict[str, Any] | None:
        """Adds a light to a node, or gives a node below it. world: (4, 4) world_from_entity."""
        lamp = Lamp(entity.message.light)
        if lamp.shape == "mesh":
            return None
        note_lamp(self.world, entity, lamp)
        if lamp.shape == "sun":
            self._sun(node, entity, lamp)
            return None
        extent = shape_extent(lamp, world)
        level = radiance(lamp, extent)
        if lamp.has_cone or (lamp.shape == "sphere" and self._is_point(lamp, world)):
            self._point(node, entity, lamp, level * extent.intensity)
            return None
        return self._shape(entity, lamp, level)

    def _is_point(self, lamp: Lamp, world: NdArray) -> bool:
        size = np.linalg.norm(world[:3, :3], axis=0).max() * lamp.size("radius")
        return bool(size <= _POINT)

    # ------------------------------------------------------------ punctual ones

    def _point(self, node: dict[str, Any], entity: Entity, lamp: Lamp, watts: NdArray) -> None:
        """watts: (3,) W/sr along the axis."""
        found: dict[str, Any] = {"type": "spot" if lamp.has_cone else "point"}
        if lamp.has_cone:
            outer = min(lamp.message.outer_cone_angle, math.pi / 2)
            inner = min(lamp.message.inner_cone_angle, outer * (1 - 1e-6))
            found["spot"] = {"innerConeAngle": inner, "outerConeAngle": outer}
            if lamp.shape != "sphere" or lamp.size("radius") > _POINT:
                self.world.notes.add(entity.title, "a spot light is written as a point with a cone")
        self._punctual(node, entity, found, watts * LUMENS_PER_WATT)

    def _sun(self, node: dict[str, Any], entity: Entity, lamp: Lamp) -> None:
        if abs(lamp.message.sun_angle - 0.0093) > 1e-4:
            self.world.notes.add(entity.title, "the angle of a sun is left out")
        self._punctual(node, entity, {"type": "directional"}, irradiance(lamp) * LUMENS_PER_WATT)

    def _punctual(
        self, node: dict[str, Any], entity: Entity, light: dict[str, Any], strength: NdArray
    ) -> None:
        """strength: (3,) cd or lx."""
        most = float(strength.max())
        light["intensity"] = most
        if most > 0:
            light["color"] = [float(x) for x in strength / most]
        if entity.name:
            light["name"] = entity.name
        self.document.extension(LIGHTS)
        root = self.document.json.setdefault("extensions", {})
        listed = root.setdefault(LIGHTS, {"lights": []})["lights"]
        listed.append(light)
        node.setdefault("extensions", {})[LIGHTS] = {"light": len(listed) - 1}

    # ------------------------------------------------------------ shapes

    def _shape(self, entity: Entity, lamp: Lamp, level: NdArray) -> dict[str, Any]:
        """A node with a mesh of its own that gives off radiance (3,)."""
        attributes, indices = self._geometry(lamp.shape)
        primitive: dict[str, Any] = {"attributes": attributes, "indices": indices}
        primitive["material"] = self._material(entity, lamp, level)
        mesh = self.document.add("meshes", {"name": entity.name, "primitives": [primitive]})
        scale = [lamp.size("radius")] * 3
        if lamp.shape == "rectangle":
            scale = [lamp.size("width"), lamp.size("height"), 1.0]
        return {"name": f"{entity.name}.light", "mesh": mesh, "scale": scale}

    def _material(self, entity: Entity, lamp: Lamp, level: NdArray) -> int:
        """Black, so that it reflects nothing."""
        most = float(level.max())
        factor = level / most if most > 0 else level
        black = {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1}
        extensions = {
            self.document.extension("KHR_materials_emissive_strength"): {"emissiveStrength": most},
            self.document.extension("KHR_materials_specular"): {"specularFactor": 0},
        }
        found: dict[str, Any] = {"name": f"{entity.name}.light", "pbrMetallicRoughness": black}
        found.update(emissiveFactor=factor.tolist(), extensions=extensions)
        if lamp.shape != "sphere" and lamp.message.two_sided:
            found["doubleSided"] = True
        return self.document.add("materials", found)

    def _geometry(self, shape: str) -> tuple[dict[str, int], int]:
        if shape not in self._shapes:
            positions, indices = SHAPES[shape]()
            found = {"POSITION": self.document.accessor(positions, VERTICES, box=True)}
            triangles = self.document.accessor(indices.astype("<u2").ravel(), INDICES)
            self._shapes[shape] = found, triangles
        return self._shapes[shape]


def _sphere() -> tuple[NdArray, NdArray]:
    """A sphere of triangles that have the area of a sphere of radius 1."""
    ball = sphere(1.0, _SEGMENTS)
    positions, indices = np.asarray(ball["positions"]), np.asarray(ball["indices"])
    a, b, c = (positions[indices[:, i]].astype("f8") for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return (positions * math.sqrt(4 * math.pi / area)).astype("<f4"), indices


def _disc() -> tuple[NdArray, NdArray]:
    """A polygon with the area of a disc of radius 1 that faces -Z."""
    step = 2 * math.pi / _SEGMENTS
    radius = math.sqrt(step / math.sin(step))
    angle = -step * np.arange(_SEGMENTS)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]) * radius
    first = np.arange(1, _SEGMENTS - 1)
    return rim.astype("<f4"), np.column_stack([0 * first, first, first + 1])


def _rectangle() -> tuple[NdArray, NdArray]:
    """A square of 1 m that faces -Z."""
    corners = np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]]) * 0.5
    return corners.astype("<f4"), np.array([[0, 1, 2], [0, 2, 3]])


SHAPES = {"sphere": _sphere, "disc": _disc, "rectangle": _rectangle}


def camera_of(world: World, entity: Entity) -> dict[str, Any] | None:
    """A camera of glTF; None, and a note: glTF has none such."""
    message: pb.Camera = entity.message.camera
    camera = Camera.from_message(message)
    if camera.projection not in ("perspective", "orthographic"):
        world.notes.add(entity.title, f"{camera.projection} cameras are left out")
        return None
    note_camera(world, entity, camera)
    middle = 0.5 * camera.width - 0.5, 0.5 * camera.height - 0.5
    if np.abs(np.subtract((camera.cx, camera.cy), middle)).max() > 1e-3:
        world.notes.add(entity.title, "the principal point is taken to be the image's centre")
    if camera.aperture:
        world.notes.add(entity.title, "the lens's aperture is left out")
    near = camera.near or _NEAR
    found: dict[str, Any] = {"type": camera.projection, "extras": {}}
    found["extras"] = {"width": camera.width, "height": camera.height}
    half = camera.width / (2 * camera.fx), camera.height / (2 * camera.fy)
    if camera.projection == "perspective":
        lens = {"aspectRatio": half[0] / half[1], "yfov": 2 * math.atan(half[1]), "znear": near}
        if camera.far != math.inf:
            lens["zfar"] = camera.far
    else:
        far = max(_FAR, 2 * near) if camera.far == math.inf else camera.far
        lens = {"xmag": half[0], "ymag": half[1], "znear": camera.near, "zfar": far}
    found[camera.projection] = lens
    if entity.name:
        found["name"] = entity.name
    return found
