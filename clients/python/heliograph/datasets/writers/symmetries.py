"""Symmetries of objects: as formats have them, and the one pose of many that look the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray, from_message
from ...client.scene import Scene
from ...errors import InvalidArgument
from .instances import Instance
from .shapes import Part


@dataclass(frozen=True)
class Axis:
    """Any rotation about an axis, (3,) of length 1, through a point, (3,) metres, is a symmetry."""

    axis: NdArray
    point: NdArray


@dataclass(frozen=True)
class Symmetries:
    """The motions that map an object onto itself, in its frame: (4, 4) matrices, metres, without
    the identity, and axes."""

    matrices: Sequence[NdArray] = ()
    axes: Sequence[Axis] = ()

    def __bool__(self) -> bool:
        return bool(self.matrices or self.axes)

    def info(self, origin: NdArray, unit: float) -> dict[str, Any]:
        """`symmetries_discrete` and `symmetries_continuous` of BOP's models_info.json, about an
        origin (3,) in the object frame, in units of 1 / unit metres."""
        moved = np.eye(4)
        moved[:3, 3] = -origin
        out: dict[str, Any] = {"symmetries_discrete": [], "symmetries_continuous": []}
        for matrix in self.matrices:
            about = moved @ matrix @ np.linalg.inv(moved)
            about[:3, 3] *= unit
            out["symmetries_discrete"].append(_plain(about.ravel()))
        for found in self.axes:
            point = found.point - origin
            offset = unit * (point - found.axis * (point @ found.axis))
            entry = {"axis": _plain(found.axis), "offset": _plain(offset)}
            out["symmetries_continuous"].append(entry)
        return {name: entries for name, entries in out.items() if entries}

    def facing(self, camera_from_object: NdArray) -> NdArray:
        """(4, 4) S, a symmetry: of the poses camera_from_object @ S, which all look the same, one
        that follows from the look alone.

        It takes the matrix after which the first axis points most upwards in the image, then x
        towards the camera, then z upwards; then it turns about that axis until x, or y where the
        axis is nearly x, points towards the camera.
        """
        back = camera_from_object[:3, :3].T
        toward = -back @ camera_from_object[:3, 3] - self._center()
        toward, up = toward / np.linalg.norm(toward), -back[:, 1]
        goals = [(found.axis, up) for found in self.axes[:1]]
        goals += [(np.eye(3)[0], toward), (np.eye(3)[2], up)]

        def met(matrix: NdArray) -> tuple[float, ...]:
            turn = matrix[:3, :3]
            return tuple(round(float(goal @ turn @ vector), 6) for vector, goal in goals)

        best = max((np.eye(4), *self.matrices), key=met)
        for found in self.axes[:1]:
            axis, goal = found.axis, best[:3, :3].T @ toward
            front = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
            cosine = front @ goal - (axis @ front) * (axis @ goal)
            about = np.eye(4)
            about[:3, :3] = rotation(axis, np.arctan2(axis @ np.cross(front, goal), cosine))
            about[:3, 3] = found.point - about[:3, :3] @ found.point
            best = best @ about
        return np.asarray(best)

    def _center(self) -> NdArray:
        """(3,) point that all of them keep fixed: the mean of the images of the origin."""
        mean = np.mean([np.zeros(3), *(matrix[:3, 3] for matrix in self.matrices)], axis=0)
        for found in self.axes[:1]:
            mean = found.point + found.axis * (found.axis @ (mean - found.point))
        return np.asarray(mean)


def symmetries_of(scene: Scene, instance: Instance, shape: Sequence[Part]) -> Symmetries:
    """Symmetries of an instance's mesh; none for several meshes, as none's symmetry is the
    whole's."""
    matrices: list[NdArray] = []
    axes: list[Axis] = []
    for part in shape if len(shape) == 1 else ():
        linear, back = part.pose[:3, :3], np.linalg.inv(part.pose)
        mesh = scene.read([scene.handle(part.mesh)], ["mesh"])[0][0].mesh
        for message in mesh.symmetries:
            if message.HasField("axis"):
                axis, offset = (np.array([v.x, v.y, v.z]) for v in (message.axis, message.offset))
                turned = linear @ axis
                point = linear @ offset + part.pose[:3, 3]
                axes.append(Axis(turned / np.linalg.norm(turned), point))
                _check_rotation(linear @ rotation(axis, 1.0) @ back[:3, :3], instance)
            else:
                matrix = part.pose @ from_message(message.matrix).astype(np.float64) @ back
                _check_rotation(matrix[:3, :3], instance)
                if not np.allclose(matrix, np.eye(4), atol=1e-6):
                    matrices.append(matrix)
    return Symmetries(matrices, axes)


def rotation(axis: NdArray, angle: float) -> NdArray:
    """(3, 3) by radians about an axis (Rodrigues 1840)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _check_rotation(motion: NdArray, instance: Instance) -> None:
    off = np.abs(motion @ motion.T - np.eye(3)).max()
    if off > 1e-4 or np.linalg.det(motion) < 0:
        raise InvalidArgument(
            f"{instance.name}: a symmetry of its mesh is no rotation once its scale "
            f"{instance.labels['scale'][instance.row]} is applied; take it off the mesh or scale "
            "evenly",
            field="symmetries",
        )


def _plain(values: NdArray) -> list[float]:
    """Numbers for JSON, rounded to 9 digits; -0 is 0."""
    return [float(v) for v in np.round(values, 9) + 0.0]
