"""Light that meshes give off besides their materials' emission. Used by the writers of files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .geometry import Geometries
from .lamps import Lamp, mesh_area, mesh_extent, radiance
from .looks import Field, Look, Use, use_of
from .motion import Poses
from .world import Entity, World, key_of


@dataclass(frozen=True)
class Emission:
    """Light that each point of a mesh gives off: W sr^-1 m^-2, by colour; use: a texture that
    multiplies it."""

    radiance: tuple[float, float, float]
    two_sided: bool
    use: Use | None = None


def emission_of(
    world: World, entity: Entity, poses: Poses, geometries: Geometries
) -> Emission | None:
    """Emission of the mesh of an entity with a light; None: it gives off nothing."""
    mesh = key_of(entity.message.mesh)
    if mesh is None or not entity.message.HasField("light"):
        return None
    lamp = Lamp(entity.message.light)
    if lamp.shape != "mesh":
        return None
    geometry = geometries[mesh]
    positions = geometry.positions_at(world.time)
    area = mesh_area(positions, geometry.indices, poses.world_now(entity.key))
    found = radiance(lamp, mesh_extent(area, lamp.message.two_sided))
    use = use_of(world, lamp.message.texture) if lamp.message.HasField("texture") else None
    return Emission((*map(float, found),), lamp.message.two_sided, use)  # type: ignore[arg-type]


def lit(world: World, look: Look, emission: Emission) -> Look:
    """Look with that light; both emissions add up, where neither has a texture."""
    total, use = np.array(emission.radiance), emission.use
    if look.emits:
        own = look["emission"], look["emission_strength"]
        if use or any(field.use for field in own):
            world.notes.add(look.name, "its emission is left out beside the light of its entity")
        else:
            total = total + np.multiply(own[0].value, own[1].value)
    fields = {"emission": Field(tuple(total), use), "emission_strength": Field(1.0)}
    return replace(look.with_fields(**fields), two_sided_emission=emission.two_sided)
