"""Copy of shown components in the daemon. push() sends the changes since the last picture, all or
nothing."""

from __future__ import annotations

from typing import Any

import numpy as np

import heliograph as hg

from .appearance import material_arguments
from .cameras import camera
from .component import Component
from .entities import entity
from .lights import light
from .materials import material
from .meshes import mesh
from .parts import Parts
from .placement import moves, shown_pose, solid, world_matrices
from .settings import current, sky_image
from .textures import texture
from .transforms import transform
from .view import View
from .volumes import volume

_KINDS: tuple[type[Component], ...] = (texture, mesh, material, volume, light, camera, transform)
_LONGEST_NAME = 256  # bytes


class Mirror:
    """Mirror of the components in one scene of a daemon: maps each to its object there."""

    def __init__(self, scene: hg.Scene) -> None:
        self.scene = scene
        self._made: dict[Component, Any] = {}  # texture, mesh, material, entity: a handle
        self._fogs: dict[entity, Any] = {}  # of those with a volume: (handle of its own, volume)
        self._moving: set[entity] = set()
        self._camera: Any = None
        self._view: Any = None
        self._black: Any = None  # the material of meshes that are a light only
        self._sky: Any = None  # the texture of the sky, the same for every sky

    def push(self, view: View) -> Any:
        """Sends the changes; returns the handle of the camera that sees `view`."""
        work = _Push(self)
        with Parts(self.scene) as parts:
            work.fill(parts, view)
        work.done()
        return self._camera


class _Push:
    """Changes of one picture. Objects that they make count only once all changes were accepted."""

    def __init__(self, mirror: Mirror) -> None:
        self.mirror = mirror
        self.made = dict(mirror._made)
        self.fogs = dict(mirror._fogs)
        self.moving = set(mirror._moving)
        self.parts: Any = None
        self.camera = mirror._camera
        self.black, self.sky = mirror._black, mirror._sky

    @property
    def edit(self) -> Any:
        return self.parts.edit

    def fill(self, parts: Parts, view: View) -> None:
        self.parts = parts
        changed, moved = self._affected()
        self._remove_entities(changed)
        for kind in (texture, material, mesh):
            for component in kind._changed:
                if component in self.made and component._alive:
                    self._send(component)
                    self.parts.room()
        self._entities(changed)
        self._poses([e for e in moved if e in self.made and e not in changed])
        self._dome()
        self._see(view)
        self._remove_shared()

    def done(self) -> None:
        mirror = self.mirror
        mirror._made, mirror._fogs, mirror._moving = self.made, self.fogs, self.moving
        mirror._camera, mirror._view = self.camera, self.view
        mirror._black, mirror._sky = self.black, self.sky
        current.dome_changed = False
        kinds: tuple[type[Component], ...] = (*_KINDS, entity)
        for kind in kinds:
            kind._changed.clear()

    # ------------------------------------------------------------ what is affected

    def _affected(self) -> tuple[dict[Any, None], dict[Any, None]]:
        """(entities to send anew, entities that have moved), in order."""
        for image in texture._changed:
            for user in image._users:
                user.mark_dirty()
        changed = dict.fromkeys(entity._changed)
        for lamp in light._changed:
            changed.update(dict.fromkeys(u for u in lamp._users if isinstance(u, entity)))
        for fog in (*volume._changed, *material._changed):
            shown = (u for u in fog._users if isinstance(u, entity) and u._volume is not None)
            changed.update(dict.fromkeys(shown))
        moved: dict[Any, None] = {}
        seen = dict.fromkeys(transform._changed)
        pending = list(seen)
        while pending:
            here = pending.pop()
            for child in here._children:
                if child not in seen:
                    seen[child] = None
                    pending.append(child)
        for here in seen:
            moved.update(here._users)
        changed.update(dict.fromkeys(found for found in moved if found._volume is not None))
        return changed, moved

    # ------------------------------------------------------------ entities

    def _remove_entities(self, changed: dict[Any, None]) -> None:
        for found in changed:
            if found in self.made and not found._is_shown():
                self.edit.remove(self.made.pop(found))
                self.moving.discard(found)
                self.parts.room()

    def _entities(self, changed: dict[Any, None]) -> None:
        shown = [found for found in changed if found._is_shown()]
        poses = self._keys(shown)
        for found, pose in zip(shown, poses):
            parts = {**self._parts(found), **pose}
            if found in self.made:
                self.edit.update(self.made[found], **parts)
            else:
                new = {name: part for name, part in parts.items() if part is not None}
                self.made[found] = self.edit.entity(_name_of(found), **new)
            self.parts.room()

    def _keys(self, entities: list[Any]) -> list[dict[str, Any]]:
        """transform= or keys= of each."""
        owners = [e._transform for e in entities]
        out = [{"transform": m} for m in solid(world_matrices(owners, previous=False))]
        moving = [i for i, owner in enumerate(owners) if moves(owner)]
        before = solid(world_matrices([owners[i] for i in moving], previous=True))
        self.moving.difference_update(entities)
        for i, matrix in zip(moving, before):
            self.moving.add(entities[i])
            out[i] = {"keys": {0.0: matrix, 1.0: out[i]["transform"]}}
        return out

    def _poses(self, entities: list[Any]) -> None:
        """New poses of entities that are there: one packed message of all that do not move."""
        still = [e for e in entities if not moves(e._transform) and e not in self.moving]
        if still:
            matrices = solid(world_matrices([e._transform for e in still], previous=False))
            self.edit.set_transforms([self.made[e] for e in still], matrices)
        placed = set(still)
        others = [e for e in entities if e not in placed]
        for found, pose in zip(others, self._keys(others)):
            self.edit.update(self.made[found], **pose)
            self.parts.room()

    def _parts(self, found: entity) -> dict[str, Any]:
        """The other arguments of Edits.entity."""
        look, lamp = found._material, found._light
        has_mesh = found._mesh is not None
        bare = not has_mesh and found._volume is None
        image = None if lamp is None else self._use_of(lamp._texture)
        return {
            "mesh": self._ref(found._mesh) if has_mesh else None,
            "material": self._ref(look) if look is not None and has_mesh else self._black(found),
            "volume": None if found._volume is None else self._fog(found),
            "light": None if lamp is None else lamp._sent(has_mesh, image),
            "visibility": found._visibility,
            "label": 0 if bare else found._id + 1,
        }

    def _black(self, found: entity) -> Any:
        """Material of a mesh that is a light only: black, so that it reflects nothing."""
        if found._mesh is None:
            return None
        if self.black is None:
            self.black = self.edit.material(None, base_color=0, specular=0, roughness=1)
        return self.black

    def _fog(self, found: entity) -> Any:
        world = shown_pose(found._transform, previous=False)[:3, :3]  # type: ignore[arg-type]
        units = 1 / abs(float(np.linalg.det(world))) ** (1 / 3)
        tint = (0.8, 0.8, 0.8) if found._material is None else found._material._values["base_color"]
        shown: Any = found._volume
        handle, old = self.fogs.get(found, (None, None))
        arguments = shown._medium(units, tint)
        if old is not shown or shown in volume._changed:
            arguments.update(shown._grid())
        made = self.edit.volume(handle, **arguments)
        self.fogs[found] = (made, shown)
        return made

    # ------------------------------------------------------------ what entities share

    def _ref(self, component: Any) -> Any:
        """The handle of a texture, material or mesh, which is sent if it is not there."""
        return self.made[component] if component in self.made else self._send(component)

    def _use_of(self, image: Any) -> Any:
        return None if image is None else hg.Tex(self._ref(image), uv=image._uv())

    def _send(self, component: Any) -> Any:
        handle = self.made.get(component)
        if isinstance(component, texture):
            encoding = "linear" if component._linear or component.is_hdr() else "srgb"
            made = self.edit.texture(handle, component._texels, encoding=encoding)
        elif isinstance(component, mesh):
            made = self.edit.mesh(handle, **component._arrays.geometry())
        else:
            made = self.edit.material(handle, **material_arguments(component, self._ref))
        self.made[component] = made
        return made

    def _remove_shared(self) -> None:
        """Removes objects of dead components, once nothing shows them; textures last, as materials
        use them."""
        removed = [c for c in self.made if not c._alive]
        for component in sorted(removed, key=lambda c: isinstance(c, texture)):
            self.edit.remove(self.made.pop(component))
            self.parts.room()
        for found in [e for e in self.fogs if e not in self.made or e._volume is None]:
            self.edit.remove(self.fogs.pop(found)[0])
            self.parts.room()

    # ------------------------------------------------------------ dome and camera

    def _dome(self) -> None:
        if not current.dome_changed:
            return
        dome = current.dome
        arguments = {"intensity": dome.strength(), "rotation": dome.turn()}
        if dome.image is not None:
            self.edit.dome(self._ref(dome.image), color=None, **arguments)
        elif dome.color is not None:
            self.edit.dome(None)
            self.edit.dome(color=dome.color, **arguments)
        else:
            wrap = ("repeat", "clamp")
            image = sky_image(dome.sky)
            self.sky = self.edit.texture(self.sky, image, encoding="linear", wrap=wrap)
            self.edit.dome(self.sky, color=None, **arguments)

    def _see(self, view: View) -> None:
        self.view = view
        if self.camera is not None and view == self.mirror._view:
            return
        parts: dict[str, Any] = {"camera": view.camera, "label": 0}
        before, now = (np.array(m) for m in view.poses)
        if np.array_equal(before, now):
            parts["transform"] = now
        else:
            parts["keys"] = {0.0: before, 1.0: now}
        if self.camera is None:
            self.camera = self.edit.entity(None, **parts)
        else:
            self.edit.update(self.camera, **parts)


def _name_of(found: entity) -> str | None:
    """Name of the entity in the daemon; None: unnamed, as the daemon would refuse that name."""
    return found._name if 0 < len(found._name.encode()) <= _LONGEST_NAME else None
