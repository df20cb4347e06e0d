"""nvisii.entity: a thing in the world: a transform with a mesh, a material, a light, a camera, a
volume."""

from __future__ import annotations

from typing import Any

import numpy as np

import heliograph as hg

from .cameras import camera
from .component import Component
from .glm.vectors import vec3
from .lights import light
from .materials import material
from .meshes import mesh
from .transforms import transform
from .volumes import volume

_KINDS: dict[str, type[Component]] = {
    "transform": transform,
    "material": material,
    "mesh": mesh,
    "light": light,
    "camera": camera,
    "volume": volume,
}


class entity(Component):
    """Shown when it has a transform, a mesh or a volume, and a material or a light; or a transform
    and a light alone. Components may be shared."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._transform: transform | None = None
        self._material: material | None = None
        self._mesh: mesh | None = None
        self._light: light | None = None
        self._camera: camera | None = None
        self._volume: volume | None = None
        self._visibility: hg.Visibility | None = None

    @classmethod
    def create(
        cls,
        name: str,
        transform: transform | None = None,
        material: material | None = None,
        mesh: mesh | None = None,
        light: light | None = None,
        camera: camera | None = None,
        volume: volume | None = None,
    ) -> entity:
        """A new entity of any of these; a mesh or a volume, not both."""
        given = (transform, material, mesh, light, camera, volume)
        made = cls(name)
        try:
            for kind, component in zip(_KINDS, given):
                if component is not None:
                    made._attach(kind, component)
        except RuntimeError:
            made._remove()
            raise
        return made

    def _attach(self, kind: str, component: Any) -> None:
        other = {"mesh": "volume", "volume": "mesh"}.get(kind)
        if component is not None and other and getattr(self, f"_{other}") is not None:
            raise RuntimeError(
                f'entity "{self._name}" has a {other}: clear_{other}() before it gets a {kind}'
            )
        self._use(f"_{kind}", _KINDS[kind], component)

    def set_transform(self, transform: transform) -> None:
        self._attach("transform", transform)

    def get_transform(self) -> transform | None:
        return self._transform

    def clear_transform(self) -> None:
        self._attach("transform", None)

    def set_material(self, material: material) -> None:
        self._attach("material", material)

    def get_material(self) -> material | None:
        return self._material

    def clear_material(self) -> None:
        self._attach("material", None)

    def set_mesh(self, mesh: mesh) -> None:
        self._attach("mesh", mesh)

    def get_mesh(self) -> mesh | None:
        return self._mesh

    def clear_mesh(self) -> None:
        self._attach("mesh", None)

    def set_light(self, light: light) -> None:
        self._attach("light", light)

    def get_light(self) -> light | None:
        return self._light

    def clear_light(self) -> None:
        self._attach("light", None)

    def set_camera(self, camera: camera) -> None:
        self._attach("camera", camera)

    def get_camera(self) -> camera | None:
        return self._camera

    def clear_camera(self) -> None:
        self._attach("camera", None)

    def set_volume(self, volume: volume) -> None:
        self._attach("volume", volume)

    def get_volume(self) -> volume | None:
        return self._volume

    def clear_volume(self) -> None:
        self._attach("volume", None)

    def set_visibility(
        self,
        camera: bool = True,
        diffuse: bool = True,
        glossy: bool = True,
        transmission: bool = True,
        volume_scatter: bool = True,
        shadow: bool = True,
    ) -> None:
        """Sets which kinds of rays meet the entity."""
        self._visibility = hg.Visibility(
            camera=bool(camera),
            diffuse=bool(diffuse),
            glossy=bool(glossy),
            transmission=bool(transmission),
            volume=bool(volume_scatter),
            shadow=bool(shadow),
        )
        self.mark_dirty()

    # ------------------------------------------------------------ where it is

    def get_min_aabb_corner(self) -> Any:
        """Lower corner, in the world, of the box about the 8 corners of the mesh's own box."""
        return vec3(*self._aabb()[0].tolist())

    def get_max_aabb_corner(self) -> Any:
        return vec3(*self._aabb()[1].tolist())

    def get_aabb_center(self) -> Any:
        return vec3(*self._aabb().mean(axis=0).tolist())

    def get_center(self) -> Any:
        """Alias of get_aabb_center()."""
        return self.get_aabb_center()

    def _aabb(self) -> Any:
        shape = self._mesh if self._mesh is not None else self._volume
        if self._transform is None or shape is None:
            raise RuntimeError(
                f'entity "{self._name}" needs a transform and a mesh or a volume to have a box'
            )
        low, high = shape._bounds()
        corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
        world = self._transform._world(False)
        moved = corners @ world[:3, :3].T + world[:3, 3]
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def _is_shown(self) -> bool:
        if not self._alive or self._transform is None:
            return False
        shape = self._mesh is not None or self._volume is not None
        return self._light is not None or (shape and self._material is not None)

    @classmethod
    def get_renderable_entities(cls) -> list[entity]:
        """Lists the entities that are shown."""
        return [found for found in cls._named.values() if found._is_shown()]

    @classmethod
    def get_dirty_entities(cls) -> list[entity]:
        """Lists the entities that changed since the last picture."""
        return [found for found in cls._changed if found._alive]

    def _used(self) -> list[Component]:
        return [used for kind in _KINDS if (used := getattr(self, f"_{kind}")) is not None]

    def _lose(self, used: Component) -> None:
        for kind in _KINDS:
            if getattr(self, f"_{kind}") is used:
                setattr(self, f"_{kind}", None)
        self.mark_dirty()

    def _release(self) -> None:
        for used in self._used():
            used._users.pop(self, None)
