"""nvisii.camera: a projection, and a lens."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import heliograph as hg

from .checks import above_zero, not_below_zero, number
from .component import Component
from .glm.matrices import mat3, mat4, rows_of

_NEAR, _FAR = 1.0, 1000.0


class camera(Component):
    """Looks down its entity's -Z, +Y is up. The projection is one of normalised coordinates, so
    that a picture of any size shows the same."""

    _missing_raises = True

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._projection = perspective(math.radians(45), 1.0)
        self._focal_distance = 1.0
        self._aperture = 0.0

    @classmethod
    def create(cls, name: str, field_of_view: float = 0.785398, aspect: float = 1.0) -> camera:
        """field_of_view: vertical, radians. aspect: width over height."""
        projection = perspective(field_of_view, aspect)
        made = cls(name)
        made._projection = projection
        return made

    @classmethod
    def create_from_fov(cls, name: str, field_of_view: float, aspect: float) -> camera:
        """field_of_view: vertical, radians. aspect: width over height."""
        return cls.create(name, field_of_view, aspect)

    @classmethod
    def create_perspective_from_fov(cls, name: str, field_of_view: float, aspect: float) -> camera:
        """The old name of create_from_fov."""
        return cls.create(name, field_of_view, aspect)

    @classmethod
    def create_from_focal_length(
        cls, name: str, focal_length: float, sensor_width: float, sensor_height: float
    ) -> camera:
        """Makes a camera from a lens: all lengths in millimetres, all above 0."""
        projection = _of_focal_length(focal_length, sensor_width, sensor_height)
        made = cls(name)
        made._projection = projection
        return made

    @classmethod
    def create_perspective_from_focal_length(
        cls, name: str, focal_length: float, sensor_width: float, sensor_height: float
    ) -> camera:
        """The old name of create_from_focal_length."""
        return cls.create_from_focal_length(name, focal_length, sensor_width, sensor_height)

    @classmethod
    def create_from_intrinsics(
        cls,
        name: str,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        width: float,
        height: float,
        near: float = 0.05,
        far: float = 100.0,
    ) -> camera:
        """Makes a camera from a calibration in pixels: integers are pixel centres, row 0 is the
        top."""
        projection = _of_intrinsics((fx, fy, cx, cy), (width, height), (near, far))
        made = cls(name)
        made._projection = projection
        return made

    def set_fov(self, field_of_view: float, aspect: float) -> None:
        """field_of_view: vertical, radians. aspect: width over height."""
        self._set(perspective(field_of_view, aspect))

    def set_focal_length(
        self, focal_length: float, sensor_width: float, sensor_height: float
    ) -> None:
        """Sets the lens: all lengths in millimetres, all above 0."""
        self._set(_of_focal_length(focal_length, sensor_width, sensor_height))

    def set_intrinsics(
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        width: float,
        height: float,
        near: float = 0.05,
        far: float = 100.0,
    ) -> None:
        """Sets a calibration in pixels: integers are pixel centres, row 0 is the top."""
        self._set(_of_intrinsics((fx, fy, cx, cy), (width, height), (near, far)))

    def set_projection(self, projection: Any) -> None:
        """A perspective mat4 as OpenGL's: w is -z."""
        matrix = rows_of(projection, 4, "projection")
        skewed = matrix[0, 1] or matrix[1, 0] or matrix[0, 3] or matrix[1, 3]
        if skewed or matrix[3].tolist() != [0, 0, -1, 0]:
            raise RuntimeError("projection: needs a perspective matrix without skew")
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise RuntimeError("projection: needs focal lengths above 0")
        self._set(matrix)

    def _set(self, projection: Any) -> None:
        self._projection = projection
        self.mark_dirty()

    def get_projection(self) -> Any:
        """The mat4 to clip space."""
        return mat4.of(self._projection)

    def get_intrinsic_matrix(self, width: float, height: float) -> Any:
        """mat3 of a picture of that size; integers are pixel centres, row 0 is the top."""
        size = number("width", width), number("height", height)
        fx, fy, cx, cy = self._intrinsics(*size)
        return mat3.of([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    def _intrinsics(self, width: float, height: float) -> tuple[float, float, float, float]:
        p = self._projection
        cx = 0.5 * width * (1 - p[0, 2]) - 0.5
        cy = 0.5 * height * (1 + p[1, 2]) - 0.5
        return 0.5 * width * p[0, 0], 0.5 * height * p[1, 1], cx, cy

    def set_focal_distance(self, distance: float) -> None:
        """Sets the distance of sharp points: metres along the optical axis, above 0."""
        self._focal_distance = above_zero("distance", distance)
        self.mark_dirty()

    def set_aperture_diameter(self, diameter: float) -> None:
        """Millimetres; 0: all is sharp."""
        self._aperture = not_below_zero("diameter", diameter)
        self.mark_dirty()

    def _sent(self, size: tuple[int, int], shift: tuple[float, float], shutter: Any) -> hg.Camera:
        """Camera as the daemon gets it. shift: moves the picture, pixels right and down."""
        fx, fy, cx, cy = self._intrinsics(*size)
        lens: dict[str, Any] = {}
        if self._aperture:
            lens = {"aperture": self._aperture / 1000, "focus_distance": self._focal_distance}
        return hg.Camera(*size, fx, fy, cx + shift[0], cy + shift[1], shutter=shutter, **lens)


def perspective(field_of_view: float, aspect: float, near: float = _NEAR, far: float = _FAR) -> Any:
    """(4, 4) [row][column] of OpenGL."""
    angle = number("field_of_view", field_of_view)
    if not 0 < angle < math.pi:
        raise RuntimeError(f"field_of_view: {field_of_view} is not between 0 and pi radians")
    focal = 1 / math.tan(0.5 * angle)
    return _matrix((focal / above_zero("aspect", aspect), focal), (0.0, 0.0), (near, far))


def _of_focal_length(focal_length: float, sensor_width: float, sensor_height: float) -> Any:
    focal = above_zero("focal_length", focal_length)
    width = above_zero("sensor_width", sensor_width)
    height = above_zero("sensor_height", sensor_height)
    return _matrix((2 * focal / width, 2 * focal / height), (0.0, 0.0), (_NEAR, _FAR))


def _of_intrinsics(
    k: tuple[float, float, float, float], size: tuple[float, float], clip: tuple[float, float]
) -> Any:
    width, height = above_zero("width", size[0]), above_zero("height", size[1])
    fx, fy = above_zero("fx", k[0]), above_zero("fy", k[1])
    cx, cy = number("cx", k[2]), number("cy", k[3])
    middle = (1 - 2 * (cx + 0.5) / width, 2 * (cy + 0.5) / height - 1)
    return _matrix((2 * fx / width, 2 * fy / height), middle, clip)


def _matrix(
    focal: tuple[float, float], middle: tuple[float, float], clip: tuple[float, float]
) -> Any:
    near, far = number("near", clip[0]), number("far", clip[1])
    if not 0 < near < far:
        raise RuntimeError(f"near, far: needs 0 < near < far, not {near} and {far}")
    return np.array(
        [
            [focal[0], 0, middle[0], 0],
            [0, focal[1], middle[1], 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )
