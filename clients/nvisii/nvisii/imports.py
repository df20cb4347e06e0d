"""import_scene(): a model's file as entities, transforms, meshes, materials, textures, lights and
cameras."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any

from heliograph._wire._proto import scene_pb2

from .cameras import camera
from .component import Component
from .entities import entity
from .glm.matrices import mat4
from .glm.vectors import Numbers
from .imported_materials import Look, textures_of
from .lights import light
from .materials import material
from .meshes import mesh
from .models import Model, is_turn_to_z_up, local_pose, pieces_of, read_model
from .textures import texture
from .transforms import transform

__all__ = ["import_scene"]

_LUMENS_PER_WATT = 683.0
_PERSPECTIVE = scene_pb2.Camera.PROJECTION_PERSPECTIVE


class scene:
    """Components that import_scene() made, by kind."""

    def __init__(self) -> None:
        self.entities: list[entity] = []
        self.transforms: list[transform] = []
        self.textures: list[texture] = []
        self.materials: list[material] = []
        self.meshes: list[mesh] = []
        self.lights: list[light] = []
        self.cameras: list[camera] = []


def import_scene(
    file_path: str,
    position: Numbers = (0.0, 0.0, 0.0),
    scale: Numbers = (1.0, 1.0, 1.0),
    rotation: Numbers = (0.0, 0.0, 0.0, 1.0),
    args: Sequence[str] = (),
) -> scene:
    """A file's objects, placed below a transform of that position, scale and rotation, which is the
    first of `transforms`. Coordinates stay those of the file. args: "verbose" prints what was left
    out; "max_quality" changes nothing.
    """
    for argument in args:
        if argument not in ("verbose", "max_quality"):
            raise RuntimeError(f'args: "verbose" or "max_quality", not {argument!r}')
    stem = os.path.splitext(os.path.basename(file_path))[0]
    model = read_model(file_path)
    importer = _Importer(model, stem)
    try:
        importer.run(transform.create(free_name(transform, stem), scale, rotation, position))
    except BaseException:
        importer.undo()
        raise
    for text in (*model.warnings, *importer.left_out):
        if "verbose" in args:
            warnings.warn(f"{file_path}: {text}", stacklevel=2)
    return importer.made


def free_name(kind: type[Component], wanted: str) -> str:
    """The name, or with a number where it is taken."""
    name, number = wanted, 1
    while kind.get(name) is not None:
        number += 1
        name = f"{wanted}_{number}"
    return name


class _Importer:
    """Importer of one file."""

    def __init__(self, model: Model, stem: str) -> None:
        self.model, self.stem = model, stem
        self.made = scene()
        self.left_out: list[str] = []
        self._looks: dict[int, Look] = {}
        self._shapes: dict[int, list[mesh]] = {}
        self._places: dict[int, transform] = {}

    def undo(self) -> None:
        for made in vars(self.made).values():
            for component in made:
                type(component).remove(component._name)

    def run(self, top: transform) -> None:
        self.made.transforms.append(top)
        images = textures_of(self.model, self._named, self.made.textures)
        for index, name, message in self.model.of_kind("material"):
            look = Look(message, images, self._named(material, name))
            self._looks[index] = look
            self.made.materials.append(look.material)
            self.made.textures += look.baked
            self.left_out += look.left_out
        for index, name, message in self.model.of_kind("mesh"):
            shapes = pieces_of(self.model, message)
            self._shapes[index] = [mesh(self._named(mesh, name), arrays) for arrays in shapes]
            self.made.meshes += self._shapes[index]
        for index, name, message in self.model.of_kind("entity"):
            self._entity(index, name, message, top)

    def _named(self, kind: type[Component], name: str) -> str:
        return free_name(kind, name or self.stem)

    def _entity(self, index: int, name: str, message: Any, top: transform) -> None:
        if name == "" and not message.HasField("mesh"):
            return  # the root, whose place `top` has
        if is_turn_to_z_up(name):
            return
        place = transform(self._named(transform, name))
        self.made.transforms.append(place)
        _put_matrix(place, local_pose(self.model, message))
        above = message.parent.created_by_edit if message.HasField("parent") else -1
        place.set_parent(self._places.get(above, top))
        self._places[index] = place
        shapes = self._shapes[message.mesh.created_by_edit] if message.HasField("mesh") else []
        for part, shape in enumerate(shapes):
            found = self._new_entity(name, place)
            found.set_mesh(shape)
            self._dress(found, message.materials.parts, part)
        if message.HasField("camera") and message.camera.projection != _PERSPECTIVE:
            self.left_out.append(f"camera {name!r} is not perspective")
        elif message.HasField("camera"):
            found = self._new_entity(name, place)
            found.set_camera(self._camera(name, message.camera))
        if message.HasField("light"):
            self._light(name, message.light, place)

    def _new_entity(self, name: str, place: transform) -> entity:
        found = entity.create(self._named(entity, name), transform=place)
        self.made.entities.append(found)
        return found

    def _dress(self, found: entity, parts: Any, part: int) -> None:
        """Its material; and a light where that emits."""
        used = parts[min(part, len(parts) - 1)] if parts else None
        if used is None or not used.HasField("created_by_edit"):
            found.set_material(self._plain())
            return
        look = self._looks[used.created_by_edit]
        found.set_material(look.material)
        lamp = look.light(self._named)
        if lamp is not None:
            if lamp not in self.made.lights:
                self.made.lights.append(lamp)
            found.set_light(lamp)

    def _plain(self) -> material:
        """Default material, for surfaces without one in the file."""
        if -1 not in self._looks:
            made = material.create(self._named(material, "default"))
            self._looks[-1] = Look.of(made)
            self.made.materials.append(made)
        return self._looks[-1].material

    def _camera(self, name: str, message: Any) -> camera:
        size = (float(message.width), float(message.height))
        k = (message.fx, message.fy, message.cx, message.cy)
        made = camera.create_from_intrinsics(self._named(camera, name), *k, *size)
        self.made.cameras.append(made)
        return made

    def _light(self, name: str, message: Any, place: transform) -> None:
        if message.sun_angle or message.outer_cone_angle:
            self.left_out.append(f"light {name!r}: suns and spot lights have no place in nvisii")
            return
        made = light.create(self._named(light, name))
        self.made.lights.append(made)
        unit = message.Unit.Name(message.unit)
        if unit not in ("UNIT_INTENSITY", "UNIT_CANDELA"):
            raise RuntimeError(f"light {name!r} is in {unit}, which no point light has")
        made.set_color((message.color.x, message.color.y, message.color.z))
        made.set_exposure(message.exposure)
        scale = 1.0 if unit == "UNIT_INTENSITY" else 1 / _LUMENS_PER_WATT
        made.set_intensity(message.intensity * scale)
        self._new_entity(name, place).set_light(made)


def _put_matrix(place: transform, matrix: Any) -> None:
    try:
        place.set_transform(mat4.of(matrix))
    except RuntimeError:
        place.set_transform(mat4.of(matrix), decompose=False)
