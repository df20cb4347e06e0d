"""Notes on properties of entities that neither format has. Used by the writers of files."""

from __future__ import annotations

from .._wire._proto import scene_pb2 as pb
from ..values.components import Camera
from .lamps import Lamp
from .world import Entity, World, key_of


def note_lamp(world: World, entity: Entity, lamp: Lamp) -> None:
    """Notes properties that are left out of a light with a shape, or a sun."""
    if key_of(lamp.message.profile) is not None:
        world.notes.add(entity.title, "the profile of a light is left out")
    if key_of(lamp.message.texture.texture) is not None:
        world.notes.add(entity.title, "the texture of a light is left out")


def note_camera(world: World, entity: Entity, camera: Camera) -> None:
    if len(camera.distortion):
        world.notes.add(entity.title, "the lens's distortion is left out")
    if camera.rgb_sensor is not None or camera.depth_sensor is not None:
        world.notes.add(entity.title, "models of sensors are left out")
    if camera.rolling:
        world.notes.add(entity.title, "the rolling shutter is left out")


def note_rest(world: World, entity: Entity, is_seen: bool) -> None:
    """Notes properties that are left out of any entity. is_seen: the file has something there that
    rays meet."""
    message = entity.message
    if key_of(message.volume) is not None:
        world.notes.add(entity.title, "volumes are left out")
    if is_seen and message.HasField("visibility") and not _is_full(message.visibility):
        world.notes.add(entity.title, "visibility by kind of ray is left out")
    if message.shadow_catcher:
        world.notes.add(entity.title, "a shadow catcher is written as any other entity")


def _is_full(visibility: pb.Visibility) -> bool:
    return all(
        getattr(visibility, field.name)
        for field in visibility.DESCRIPTOR.fields
        if visibility.HasField(field.name)
    )
