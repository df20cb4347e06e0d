"""nvisii.mesh: triangles; by formula, of a file or of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from .component import Component
from .glm.vectors import vec2, vec3, vec4
from .mesh_data import Arrays, smooth_normals, tangents_of
from .mesh_factories import Factories


class mesh(Component, Factories):
    """Immutable once it is made; shared by any number of entities, uploaded once."""

    def __init__(self, name: str, arrays: Arrays) -> None:
        super().__init__(name)
        self._arrays = arrays
        positions = arrays.positions
        self._box = np.stack([positions.min(axis=0), positions.max(axis=0)]).astype(float)

    def get_vertices(self) -> list[list[float]]:
        """Positions, [x, y, z] each."""
        rows: list[list[float]] = self._arrays.positions.tolist()
        return rows

    def get_colors(self) -> list[Any]:
        """Colours of the vertices, a list of vec4."""
        return [vec4(*row) for row in self._arrays.colors.tolist()]

    def get_normals(self) -> list[Any]:
        """vec4, w = 0."""
        return [vec4(*row, 0.0) for row in self._arrays.normals.tolist()]

    def get_tangents(self) -> list[Any]:
        """vec4; w: the sign of the bitangent."""
        return [vec4(*row) for row in tangents_of(self._arrays).tolist()]

    def get_tex_coords(self) -> list[Any]:
        """vec2."""
        return [vec2(*row) for row in self._arrays.uvs.tolist()]

    def get_triangle_indices(self) -> list[int]:
        """Three a triangle."""
        flat: list[int] = self._arrays.indices.reshape(-1).tolist()
        return flat

    def get_center(self) -> Any:
        """The mean of the vertices."""
        return vec3(*self._arrays.positions.astype(float).mean(axis=0).tolist())

    def get_min_aabb_corner(self) -> Any:
        return vec3(*self._bounds()[0].tolist())

    def get_max_aabb_corner(self) -> Any:
        return vec3(*self._bounds()[1].tolist())

    def get_aabb_center(self) -> Any:
        return vec3(*self._bounds().mean(axis=0).tolist())

    def get_bounding_sphere_radius(self) -> float:
        """Radius of the sphere about get_center() that holds all vertices."""
        positions = self._arrays.positions.astype(float)
        return float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max())

    def compute_metadata(self) -> None:
        """Does nothing: centre, box and radius are always those of the vertices."""

    def generate_smooth_normals(self) -> None:
        """Makes smooth normals: those of the triangles about a vertex, weighted by angle and
        area."""
        arrays = self._arrays
        normals = smooth_normals(arrays.positions, arrays.indices)
        self._arrays = arrays._replace(normals=normals, tangents=None)
        self.mark_dirty()

    def generate_smooth_tangents(self) -> None:
        """Makes new tangents, along growing u."""
        self._arrays = self._arrays._replace(tangents=None)
        self.mark_dirty()

    def _bounds(self) -> Any:
        """(2, 3) float64."""
        return self._box
