"""The create_* functions of nvisii.mesh for triangles, polygons, lines and tubes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .checks import checked_factories
from .glm.vectors import Numbers, floats
from .tessellation import boxes, profiles, surface
from .tessellation.surface import TURN, Surface

if TYPE_CHECKING:
    from .meshes import mesh

_V0, _V1, _V2 = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


@checked_factories
class PathFactories:
    """Factories of meshes from paths. Each returns a new mesh."""

    @classmethod
    def _made(cls, name: str, made: Any) -> mesh:
        raise NotImplementedError

    @classmethod
    def create_triangle(
        cls,
        name: str,
        v0: Numbers = _V0,
        v1: Numbers = _V1,
        v2: Numbers = _V2,
        segments: int = 4,
    ) -> mesh:
        """Faces where its corners run counter-clockwise."""
        return cls._made(name, surface.triangle(_corners(v0, v1, v2), segments))

    @classmethod
    def create_triangle_from_circumscribed_circle(
        cls, name: str, radius: float = 1.0, segments: int = 4
    ) -> mesh:
        """Equilateral, in the plane z = 0."""
        return cls._made(name, surface.triangle(_regular(radius, 3), segments))

    @classmethod
    def create_spherical_triangle_from_sphere(
        cls, name: str, radius: float = 1.0, segments: int = 4
    ) -> mesh:
        """An eighth of a sphere, between +X, +Y and +Z."""
        flat = surface.triangle(np.eye(3) * radius, segments)
        return cls._made(name, boxes.spherified(flat, radius))

    @classmethod
    def create_spherical_triangle_from_triangle(
        cls,
        name: str,
        v0: Numbers = (1.0, 0.0, 0.0),
        v1: Numbers = (0.0, 1.0, 0.0),
        v2: Numbers = (0.0, 0.0, 1.0),
        segments: int = 4,
    ) -> mesh:
        """Corners on a sphere about the origin, of v0's radius."""
        corners = _corners(v0, v1, v2)
        radius = float(np.linalg.norm(corners[0]))
        return cls._made(name, boxes.spherified(surface.triangle(corners, segments), radius))

    @classmethod
    def create_convex_polygon(
        cls, name: str, vertices: Any, segments: int = 1, rings: int = 1
    ) -> mesh:
        """Fills a convex polygon of vec2s, counter-clockwise, in the plane z = 0."""
        flat = [(*floats(v, 2, f"vertices[{i}]"), 0.0) for i, v in enumerate(vertices)]
        return cls._made(name, surface.polygon(flat, segments, rings))

    @classmethod
    def create_convex_polygon_from_circle(
        cls, name: str, radius: float = 1.0, sides: int = 5, segments: int = 4, rings: int = 4
    ) -> mesh:
        """Regular, its corners on a circle."""
        return cls._made(name, surface.polygon(_regular(radius, sides), segments, rings))

    @classmethod
    def create_line(
        cls, name: str, start: Numbers, stop: Numbers, radius: float = 1.0, segments: int = 16
    ) -> mesh:
        """A tube from start to stop; segments: about it."""
        ends = [floats(start, 3, "start"), floats(stop, 3, "stop")]
        return cls._made(name, _tube(ends, profiles.circle(radius, segments)))

    @classmethod
    def create_tube_from_polyline(
        cls, name: str, path: Any, radius: float = 1.0, segments: int = 16
    ) -> mesh:
        """A round tube through the points of a path; segments: about it."""
        return cls._made(name, _tube(_points(path), profiles.circle(radius, segments)))

    @classmethod
    def create_rectangle_tube_from_polyline(
        cls, name: str, path: Any, size: Numbers = (1.0, 1.0), segments: Numbers = (8, 8)
    ) -> mesh:
        """A tube whose section is a rectangle."""
        sizes, counts = floats(size, 2, "size"), floats(segments, 2, "segments")
        return cls._made(name, _tube(_points(path), profiles.rectangle(sizes, counts)))

    @classmethod
    def create_rounded_rectangle_tube_from_polyline(
        cls,
        name: str,
        path: Any,
        radius: float = 1.0,
        size: Numbers = (0.75, 0.75),
        slices: int = 4,
        segments: Numbers = (8, 8),
    ) -> mesh:
        """A tube whose section is a rectangle, grown by the radius."""
        sizes, counts = floats(size, 2, "size"), floats(segments, 2, "segments")
        section = profiles.rounded_rectangle(radius, sizes, slices, counts)
        return cls._made(name, _tube(_points(path), section))


def _corners(v0: Numbers, v1: Numbers, v2: Numbers) -> Any:
    return np.array([floats(v, 3, f"v{i}") for i, v in enumerate((v0, v1, v2))])


def _regular(radius: float, sides: int) -> Any:
    if sides < 3:
        raise RuntimeError(f"sides: {sides} is below 3")
    angle = np.arange(int(sides)) * TURN / int(sides)
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def _points(path: Any) -> list[tuple[float, ...]]:
    return [floats(point, 3, f"path[{i}]") for i, point in enumerate(path)]


def _tube(path: Any, section: tuple[Any, Any]) -> Surface:
    frames = surface.carried_frames(path)
    return surface.extruded(section[0], section[1], np.asarray(path, dtype=float), frames)
