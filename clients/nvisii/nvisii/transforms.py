"""nvisii.transform: where things are, now and at the previous frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .checks import above_zero, number
from .component import Component
from .glm.matrices import mat4, rows_of
from .glm.quaternions import angleAxis, conjugate, of_rotation, product, quat, quat_of
from .glm.rotations import slerp
from .glm.vectors import Numbers, floats, vec3
from .placement import (
    FOLLOWS,
    NO_TURN,
    STILL,
    Placement,
    decompose,
    inverted,
    look,
    powered,
    vector_of_world,
)

_KEEP = (math.nan, math.nan, math.nan)


class transform(Component):
    """Scale, then rotation, then translation, then an optional further matrix; relative to a
    parent. previous=True is about the pose at the previous frame; until it is set, that is the
    pose of now moved back by the velocities."""

    def __init__(self, name: str, now: Placement | None = None) -> None:
        super().__init__(name)
        self._now = now or Placement()
        self._before = FOLLOWS
        self._linear = self._scaling = STILL
        self._angular = NO_TURN
        self._parent: transform | None = None
        self._children: dict[transform, None] = {}

    @classmethod
    def create(
        cls,
        name: str,
        scale: Numbers = (1.0, 1.0, 1.0),
        rotation: Numbers = (0.0, 0.0, 0.0, 1.0),
        position: Numbers = (0.0, 0.0, 0.0),
    ) -> transform:
        """A new transform. scale, position: 3 numbers. rotation: a quat, or x, y, z, w."""
        placement = Placement(
            floats(scale, 3, "scale"),
            quat_of(rotation, "rotation"),
            floats(position, 3, "position"),
        )
        return cls(name, placement)

    @classmethod
    def create_from_matrix(cls, name: str, transform: Any = None) -> transform:
        """A new transform of a mat4, which is decomposed."""
        matrix = mat4() if transform is None else transform
        made = cls(name)
        try:
            made.set_transform(matrix)
        except RuntimeError:
            made._remove()
            raise
        return made

    # ------------------------------------------------------------ at an instant

    def _at(self, previous: bool) -> Placement:
        """The placement of now, or of the previous frame."""
        if not previous:
            return self._now
        now, before = self._now, self._before
        scale, rotation, position = before.scale, before.rotation, before.position
        if scale is None:
            scale = tuple(a - b for a, b in zip(now.scale or (), self._scaling))
        if rotation is None:
            rotation = product(conjugate(self._angular), now.rotation or NO_TURN)
        if position is None:
            position = tuple(a - b for a, b in zip(now.position or (), self._linear))
        matrix = now.matrix if before.matrix is None else before.matrix
        return Placement(scale, rotation, position, matrix)

    def _put(self, previous: bool, **values: Any) -> None:
        if previous and self._before is FOLLOWS:
            self._before = replace(FOLLOWS)
        target = self._before if previous else self._now
        for name, value in values.items():
            setattr(target, name, value)
        self._changed[self] = None

    def _world(self, previous: bool) -> Any:
        """(4, 4) float64, world from local."""
        local = self._at(previous).rows()
        return local if self._parent is None else self._parent._world(previous) @ local

    # ------------------------------------------------------------ position, rotation, scale

    def get_position(self, previous: bool = False) -> Any:
        return vec3(*(self._at(previous).position or ()))

    def set_position(self, position: Numbers, previous: bool = False) -> None:
        self._put(previous, position=floats(position, 3, "position"))

    def add_position(self, additional_position: Numbers, previous: bool = False) -> None:
        more = floats(additional_position, 3, "additional_position")
        self.set_position(self.get_position(previous) + more, previous)

    def get_scale(self, previous: bool = False) -> Any:
        return vec3(*(self._at(previous).scale or ()))

    def set_scale(self, scale: Numbers, previous: bool = False) -> None:
        self._put(previous, scale=floats(scale, 3, "scale"))

    def add_scale(self, additional_scale: Numbers, previous: bool = False) -> None:
        more = floats(additional_scale, 3, "additional_scale")
        self.set_scale(self.get_scale(previous) + more, previous)

    def get_rotation(self, previous: bool = False) -> quat:
        return quat(self._at(previous).rotation)

    def set_rotation(self, rotation: Numbers, previous: bool = False) -> None:
        self._put(previous, rotation=quat_of(rotation, "rotation"))

    def add_rotation(self, additional_rotation: Numbers, previous: bool = False) -> None:
        """Turns further, about the parent's axes."""
        more = quat_of(additional_rotation, "additional_rotation")
        self._put(previous, rotation=product(more, self.get_rotation(previous)))

    def set_angle_axis(self, angle: float, axis: Numbers, previous: bool = False) -> None:
        """The rotation by `angle` radians about an axis."""
        self.set_rotation(angleAxis(angle, axis), previous)

    def add_angle_axis(self, angle: float, axis: Numbers, previous: bool = False) -> None:
        """Turns further, by `angle` radians about an axis of the parent."""
        self.add_rotation(angleAxis(angle, axis), previous)

    def look_at(
        self, at: Numbers, up: Numbers, eye: Numbers = _KEEP, previous: bool = False
    ) -> None:
        """Turns local -Z towards `at`, with local +Y as near to `up` as it can be. `eye` is the
        position from then on; without it the position stays. In the parent's space."""
        place = floats(eye, 3, "eye", finite=False)
        kept = any(map(math.isnan, place))
        place = (self._at(previous).position or ()) if kept else floats(place, 3, "eye")
        matrix = look(np.array(place), np.array(floats(at, 3, "at")), np.array(floats(up, 3, "up")))
        self._put(previous, rotation=of_rotation(matrix), position=place)

    def rotate_around(self, point: Numbers, rotation: Numbers, previous: bool = False) -> None:
        """Turns position and rotation about a point of the parent's space."""
        center, turn = vec3(*floats(point, 3, "point")), quat_of(rotation, "rotation")
        moved = center + turn * (self.get_position(previous) - center)
        turned = product(turn, self.get_rotation(previous))
        self._put(previous, position=tuple(moved), rotation=turned)

    def set_transform(self, transform: Any, decompose: bool = True, previous: bool = False) -> None:
        """Takes a mat4. decompose: as scale, rotation and position, which replaces all; a matrix
        that skews is refused. Otherwise it is applied after scale, rotation and position."""
        matrix = rows_of(transform, 4, "transform")
        if decompose:
            scale, rotation, position = decompose_or_raise(matrix)
            self._put(previous, scale=scale, rotation=rotation, position=position)
            matrix = np.eye(4)
        self._put(previous, matrix=matrix)

    # ------------------------------------------------------------ axes

    def get_right(self, previous: bool = False) -> Any:
        """Local +X in the parent's space, with the scale."""
        return _column(self._at(previous).rows(), 0)

    def get_up(self, previous: bool = False) -> Any:
        """Local +Y in the parent's space, with the scale."""
        return _column(self._at(previous).rows(), 1)

    def get_forward(self, previous: bool = False) -> Any:
        """Local +Z in the parent's space, with the scale; cameras look the other way."""
        return _column(self._at(previous).rows(), 2)

    def get_world_position(self, previous: bool = False) -> Any:
        return _column(self._world(previous), 3)

    def get_world_right(self, previous: bool = False) -> Any:
        return _column(self._world(previous), 0)

    def get_world_up(self, previous: bool = False) -> Any:
        return _column(self._world(previous), 1)

    def get_world_forward(self, previous: bool = False) -> Any:
        """Local +Z in the world; cameras look the other way."""
        return _column(self._world(previous), 2)

    # ------------------------------------------------------------ motion

    def set_linear_velocity(
        self, velocity: Numbers, frames_per_second: float = 1.0, mix: float = 0.0
    ) -> None:
        """Distance a second. mix: share of the velocity of before."""
        new = _mixed(velocity, frames_per_second, mix, self._linear)
        self._before, self._linear = replace(self._before, position=None), new
        self.mark_dirty()

    def set_angular_velocity(
        self, velocity: Numbers, frames_per_second: float = 1.0, mix: float = 0.0
    ) -> None:
        """The rotation of a second. mix: share of the velocity of before."""
        rate = above_zero("frames_per_second", frames_per_second)
        step = powered(quat_of(velocity, "velocity"), 1.0 / rate)
        self._angular = slerp(step, self._angular, number("mix", mix))
        self._before = replace(self._before, rotation=None)
        self.mark_dirty()

    def set_scalar_velocity(
        self, velocity: Numbers, frames_per_second: float = 1.0, mix: float = 0.0
    ) -> None:
        """Change of the scale a second. mix: share of the velocity of before."""
        new = _mixed(velocity, frames_per_second, mix, self._scaling)
        self._before, self._scaling = replace(self._before, scale=None), new
        self.mark_dirty()

    def clear_motion(self) -> None:
        """The previous pose is that of now, and follows it."""
        self._before = FOLLOWS
        self._linear = self._scaling = STILL
        self._angular = NO_TURN
        self.mark_dirty()

    # ------------------------------------------------------------ between spaces

    def transform_direction(self, direction: Numbers, previous: bool = False) -> Any:
        """Local to world, by the rotation alone: the length stays."""
        return vector_of_world(self, direction, "direction", previous)

    def transform_point(self, point: Numbers, previous: bool = False) -> Any:
        """Local to world."""
        return vector_of_world(self, point, "point", previous)

    def transform_vector(self, vector: Numbers, previous: bool = False) -> Any:
        """Local to world, by rotation and scale."""
        return vector_of_world(self, vector, "vector", previous)

    def inverse_transform_direction(self, direction: Numbers, previous: bool = False) -> Any:
        return vector_of_world(self, direction, "direction", previous, inverse=True)

    def inverse_transform_point(self, point: Numbers, previous: bool = False) -> Any:
        return vector_of_world(self, point, "point", previous, inverse=True)

    def inverse_transform_vector(self, vector: Numbers, previous: bool = False) -> Any:
        return vector_of_world(self, vector, "vector", previous, inverse=True)

    def get_local_to_parent_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._at(previous).rows())

    def get_parent_to_local_matrix(self, previous: bool = False) -> Any:
        return mat4.of(inverted(self._at(previous).rows()))

    def get_local_to_parent_translation_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._at(previous).translation())

    def get_local_to_parent_scale_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._at(previous).scaling())

    def get_local_to_parent_rotation_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._at(previous).turning())

    def get_parent_to_local_translation_matrix(self, previous: bool = False) -> Any:
        return mat4.of(inverted(self._at(previous).translation()))

    def get_parent_to_local_scale_matrix(self, previous: bool = False) -> Any:
        return mat4.of(inverted(self._at(previous).scaling()))

    def get_parent_to_local_rotation_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._at(previous).turning().T)

    def get_local_to_world_matrix(self, previous: bool = False) -> Any:
        return mat4.of(self._world(previous))

    def get_world_to_local_matrix(self, previous: bool = False) -> Any:
        return mat4.of(inverted(self._world(previous)))

    # ------------------------------------------------------------ parents

    def set_parent(self, parent: transform) -> None:
        """Makes this transform relative to its parent. RuntimeError for a cycle."""
        if not isinstance(parent, transform):
            raise RuntimeError(f"parent: needs a nvisii.transform, not {parent!r}")
        above: transform | None = parent
        while above is not None:
            if above is self:
                raise RuntimeError(f'parent: "{parent._name}" is below "{self._name}": a cycle')
            above = above._parent
        self.clear_parent()
        self._parent = parent
        parent._children[self] = None
        self.mark_dirty()

    def clear_parent(self) -> None:
        if self._parent is not None:
            self._parent._children.pop(self, None)
            self._parent = None
            self.mark_dirty()

    def get_parent(self) -> transform | None:
        return self._parent

    def get_children(self) -> list[transform]:
        return list(self._children)

    def add_child(self, child: transform) -> None:
        child.set_parent(self)

    def remove_child(self, child: transform) -> None:
        if child._parent is self:
            child.clear_parent()

    def _release(self) -> None:
        self.clear_parent()
        for child in list(self._children):
            child.clear_parent()


def decompose_or_raise(matrix: Any) -> tuple[Any, quat, Any]:
    """(scale, rotation, position) of a (4, 4)."""
    found = decompose(matrix)
    if found is None:
        raise RuntimeError(
            "transform: the matrix skews, projects or has no inverse: it is no scale, rotation and "
            "position; use decompose=False"
        )
    return found


def _mixed(velocity: Numbers, rate: float, mix: float, old: Sequence[float]) -> tuple[float, ...]:
    new = floats(velocity, 3, "velocity")
    rate, mix = above_zero("frames_per_second", rate), number("mix", mix)
    return tuple(v / rate * (1 - mix) + o * mix for v, o in zip(new, old))


def _column(matrix: Any, index: int) -> Any:
    return vec3(*matrix[:3, index].tolist())
