"""The create_* functions of nvisii.mesh: sizes are halves, round things are about +Z."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .checks import above_zero, checked_factories
from .glm.vectors import Numbers, floats
from .mesh_data import Arrays, of_data, of_surface, rows
from .mesh_paths import PathFactories
from .tessellation import boxes, round, surface, teapot
from .tessellation.surface import TURN, Arc, Surface, merged

if TYPE_CHECKING:
    from .meshes import mesh

_PI = math.pi


@checked_factories
class Factories(PathFactories):
    """Factories of meshes. Each returns a new mesh."""

    @classmethod
    def _made(cls, name: str, made: Surface | Arrays) -> mesh:
        arrays = of_surface(made) if isinstance(made, Surface) else made
        build: Any = cls
        found: mesh = build(name, arrays)
        return found

    # ------------------------------------------------------------ boxes and solids

    @classmethod
    def create_box(
        cls, name: str, size: Numbers = (1.0, 1.0, 1.0), segments: Numbers = (1, 1, 1)
    ) -> mesh:
        """A box with flat faces."""
        sizes, counts = floats(size, 3, "size"), floats(segments, 3, "segments")
        return cls._made(name, boxes.box(sizes, counts))

    @classmethod
    def create_rounded_box(
        cls,
        name: str,
        radius: float = 0.25,
        size: Numbers = (0.75, 0.75, 0.75),
        slices: int = 4,
        segments: Numbers = (1, 1, 1),
    ) -> mesh:
        """A box of half sides `size`, grown by the radius."""
        sizes, counts = floats(size, 3, "size"), floats(segments, 3, "segments")
        return cls._made(name, boxes.rounded_box(radius, np.array(sizes), slices, counts))

    @classmethod
    def create_plane(
        cls,
        name: str,
        size: Numbers = (1.0, 1.0),
        segments: Numbers = (8, 8),
        flip_z: bool = False,
    ) -> mesh:
        """A rectangle that faces +Z; flip_z: -Z."""
        flat = surface.plane(floats(size, 2, "size"), floats(segments, 2, "segments"))
        return cls._made(name, flat.flipped() if flip_z else flat)

    @classmethod
    def create_icosphere(cls, name: str, radius: float = 1.0, segments: int = 4) -> mesh:
        """A sphere of 20 subdivided triangles."""
        return cls._made(name, boxes.icosphere(above_zero("radius", radius), segments))

    @classmethod
    def create_icosahedron(cls, name: str, radius: float = 1.0, segments: int = 1) -> mesh:
        return cls._made(name, boxes.icosahedron(above_zero("radius", radius), segments))

    @classmethod
    def create_dodecahedron(
        cls, name: str, radius: float = 1.0, segments: int = 1, rings: int = 1
    ) -> mesh:
        return cls._made(name, boxes.dodecahedron(above_zero("radius", radius), segments, rings))

    @classmethod
    def create_teapotahedron(cls, name: str, segments: int = 8) -> mesh:
        """Newell's teapot, 1975, standing on z = 0; segments of each of its 32 patches."""
        return cls._made(name, teapot.teapot(segments))

    @classmethod
    def create_wireframe_bounding_box(
        cls,
        name: str,
        min_corner: Numbers = (-1.0, -1.0, -1.0),
        max_corner: Numbers = (1.0, 1.0, 1.0),
        thickness: float = 0.01,
    ) -> mesh:
        """Bars along the twelve edges of a box."""
        low, high = floats(min_corner, 3, "min_corner"), floats(max_corner, 3, "max_corner")
        return cls._made(name, boxes.wires(np.array(low), np.array(high), thickness))

    # ------------------------------------------------------------ round things

    @classmethod
    def create_sphere(
        cls,
        name: str,
        radius: float = 1.0,
        slices: int = 32,
        segments: int = 16,
        sliceStart: float = 0.0,
        sliceSweep: float = TURN,
        segmentStart: float = 0.0,
        segmentSweep: float = _PI,
    ) -> mesh:
        """slices: about +Z. segments: from pole to pole; their angles are from +Z."""
        arc = Arc(slices, sliceStart, sliceSweep)
        return cls._made(name, round.sphere(radius, segments, arc, (segmentStart, segmentSweep)))

    @classmethod
    def create_cylinder(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        """Open at both ends."""
        return cls._made(name, round.cylinder(radius, size, segments, Arc(slices, start, sweep)))

    @classmethod
    def create_capped_cylinder(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 1,
        rings: int = 1,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        arc = Arc(slices, start, sweep)
        caps = [round.cap(radius, 0.0, z, rings, arc) for z in (size, -size)]
        return cls._made(name, merged([round.cylinder(radius, size, segments, arc), *caps]))

    @classmethod
    def create_cone(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        """Open below; the tip is above."""
        return cls._made(name, round.cone(radius, size, segments, Arc(slices, start, sweep)))

    @classmethod
    def create_capped_cone(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        rings: int = 4,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        arc = Arc(slices, start, sweep)
        parts = [round.cone(radius, size, segments, arc), round.cap(radius, 0.0, -size, rings, arc)]
        return cls._made(name, merged(parts))

    @classmethod
    def create_spherical_cone(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        rings: int = 4,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        """A cone whose base is a part of a sphere about its tip, which is below."""
        arc = Arc(slices, start, sweep)
        return cls._made(name, round.spherical_cone(radius, size, (segments, rings), arc))

    @classmethod
    def create_capsule(
        cls,
        name: str,
        radius: float = 1.0,
        size: float = 0.5,
        slices: int = 32,
        segments: int = 4,
        rings: int = 8,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        """size: half of the length between the half spheres."""
        arc = Arc(slices, start, sweep)
        return cls._made(name, round.capsule(radius, size, (segments, rings), arc))

    @classmethod
    def create_tube(
        cls,
        name: str,
        radius: float = 1.0,
        innerRadius: float = 0.75,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        arc = Arc(slices, start, sweep)
        return cls._made(name, round.tube((radius, innerRadius), size, segments, arc))

    @classmethod
    def create_capped_tube(
        cls,
        name: str,
        radius: float = 1.0,
        innerRadius: float = 0.75,
        size: float = 1.0,
        slices: int = 32,
        segments: int = 8,
        rings: int = 1,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        arc = Arc(slices, start, sweep)
        caps = [round.cap(radius, innerRadius, z, rings, arc) for z in (size, -size)]
        return cls._made(
            name, merged([round.tube((radius, innerRadius), size, segments, arc), *caps])
        )

    @classmethod
    def create_disk(
        cls,
        name: str,
        radius: float = 1.0,
        innerRadius: float = 0.0,
        slices: int = 32,
        rings: int = 4,
        start: float = 0.0,
        sweep: float = TURN,
    ) -> mesh:
        """Faces +Z."""
        return cls._made(name, surface.disk(radius, innerRadius, rings, Arc(slices, start, sweep)))

    @classmethod
    def create_torus(
        cls,
        name: str,
        minor: float = 0.25,
        major: float = 1.0,
        slices: int = 16,
        segments: int = 32,
        minorStart: float = 0.0,
        minorSweep: float = TURN,
        majorStart: float = 0.0,
        majorSweep: float = TURN,
    ) -> mesh:
        """slices: about the tube. segments: about +Z."""
        arc = Arc(segments, majorStart, majorSweep)
        return cls._made(name, round.torus((minor, major), slices, (minorStart, minorSweep), arc))

    @classmethod
    def create_torus_knot(
        cls, name: str, p: int = 2, q: int = 3, slices: int = 8, segments: int = 96
    ) -> mesh:
        """p turns about +Z, q about the torus; the tube's radius is 1/4."""
        return cls._made(name, round.torus_knot(p, q, slices, segments))

    @classmethod
    def create_spring(
        cls,
        name: str,
        minor: float = 0.25,
        major: float = 1.0,
        size: float = 1.0,
        slices: int = 8,
        segments: int = 32,
        minorStart: float = 0.0,
        minorSweep: float = TURN,
        majorStart: float = 0.0,
        majorSweep: float = 2 * TURN,
    ) -> mesh:
        """A torus whose middle goes from -size to size."""
        arc, tube = Arc(segments, majorStart, majorSweep), (minorStart, minorSweep)
        return cls._made(name, round.torus((minor, major), slices, tube, arc, rise=2 * size))

    # ------------------------------------------------------------ arrays and files

    @classmethod
    def create_from_data(
        cls,
        name: str,
        positions: Any,
        position_dimensions: int = 3,
        normals: Any = (),
        normal_dimensions: int = 3,
        tangents: Any = (),
        tangent_dimensions: int = 3,
        colors: Any = (),
        color_dimensions: int = 3,
        texcoords: Any = (),
        texcoord_dimensions: int = 2,
        indices: Any = (),
    ) -> mesh:
        """Makes a mesh from flat lists or arrays. Without indices three vertices are a triangle,
        and equal ones are joined. Missing normals are smooth, missing tangents follow u."""
        arrays = of_data(
            rows(positions, position_dimensions, (3, 4), "positions"),
            rows(normals, normal_dimensions, (3, 4), "normals"),
            rows(tangents, tangent_dimensions, (3, 4), "tangents"),
            rows(colors, color_dimensions, (3, 4), "colors"),
            rows(texcoords, texcoord_dimensions, (2,), "texcoords"),
            indices,
        )
        return cls._made(name, arrays)

    @classmethod
    def create_from_file(cls, name: str, path: str) -> mesh:
        """Joins the shapes of a model's file into one mesh; its materials are left out."""
        from .models import merged_mesh

        return cls._made(name, merged_mesh(path))

    @classmethod
    def create_from_obj(cls, name: str, path: str) -> mesh:
        """The old name of create_from_file."""
        return cls.create_from_file(name, path)
