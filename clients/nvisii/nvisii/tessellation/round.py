"""Round things about +Z: spheres, cylinders, cones, capsules, tubes, tori, springs, knots."""

from __future__ import annotations

import math

import numpy as np

from .surface import (
    TURN,
    Arc,
    Surface,
    arc_profile,
    disk,
    extruded,
    lathe,
    line_profile,
    merged,
    steps,
)

_QUARTER = math.pi / 2


def sphere(radius: float, segments: int, arc: Arc, polar: tuple[float, float]) -> Surface:
    """polar: start and sweep, radians from +Z."""
    start, sweep = polar
    angles = (_QUARTER - start - sweep, _QUARTER - start)
    return lathe(*arc_profile((0, 0), radius, angles, segments), arc)


def cylinder(radius: float, size: float, segments: int, arc: Arc) -> Surface:
    """Open cylinder about +Z, from -size to size."""
    return lathe(*line_profile((radius, -size), (radius, size), segments), arc)


def cone(radius: float, size: float, segments: int, arc: Arc) -> Surface:
    """Open cone about +Z, from its base at -size to its tip at size."""
    return lathe(*line_profile((radius, -size), (0, size), segments), arc)


def cap(radius: float, inner: float, z: float, rings: int, arc: Arc) -> Surface:
    """A disk at height z that faces away from the origin."""
    flat = disk(radius, inner, rings, arc)
    flat = flat if z >= 0 else flat.flipped()
    return flat.placed(np.eye(3), (0, 0, z))


def spherical_cone(radius: float, size: float, counts: tuple[int, int], arc: Arc) -> Surface:
    """A cone, its tip at -size, and a part of a sphere about the tip. counts: segments, rings."""
    segments, rings = counts
    slant, angle = math.hypot(radius, 2 * size), math.atan2(2 * size, radius)
    body = lathe(*line_profile((0, -size), (radius, size), segments), arc)
    dome = lathe(*arc_profile((0, -size), slant, (angle, _QUARTER), rings), arc)
    return merged([body, dome])


def capsule(radius: float, size: float, counts: tuple[int, int], arc: Arc) -> Surface:
    """A cylinder from -size to size between half spheres. counts: segments, rings."""
    segments, rings = counts
    return merged(
        [
            cylinder(radius, size, segments, arc),
            lathe(*arc_profile((0, size), radius, (0, _QUARTER), rings), arc),
            lathe(*arc_profile((0, -size), radius, (-_QUARTER, 0), rings), arc),
        ]
    )


def tube(radii: tuple[float, float], size: float, segments: int, arc: Arc) -> Surface:
    """A cylinder and one within, which faces inwards. radii: outer, inner."""
    inner = cylinder(radii[1], size, segments, arc).flipped()
    return merged([cylinder(radii[0], size, segments, arc), inner])


def torus(
    radii: tuple[float, float], slices: int, minor: tuple[float, float], arc: Arc, rise: float = 0.0
) -> Surface:
    """radii: of the tube (minor) and to its middle (major). minor: start and sweep about the tube.
    arc: about +Z. rise: makes it a spring."""
    angles = (minor[0], minor[0] + minor[1])
    profile, outward = arc_profile((radii[1], 0), radii[0], angles, slices)
    return lathe(profile, outward, arc, rise)


def torus_knot(p: int, q: int, slices: int, segments: int) -> Surface:
    """A tube of radius 1/4 that goes p times about +Z and q times about a torus of radii 1, 1/2."""
    t = steps(segments) * TURN
    about, over = p * t, q * t
    r = 0.5 * (2 + np.cos(over))
    path = np.stack([r * np.cos(about), r * np.sin(about), 0.5 * np.sin(over)], axis=1)
    slope = -0.5 * q * np.sin(over)
    along = np.stack(
        [
            slope * np.cos(about) - r * p * np.sin(about),
            slope * np.sin(about) + r * p * np.cos(about),
            0.5 * q * np.cos(over),
        ],
        axis=1,
    )
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    middle = np.stack([np.cos(about), np.sin(about), np.zeros_like(about)], axis=1)
    x = path - middle
    x -= along * (x * along).sum(axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(along, x)], axis=1)
    circle, outward = arc_profile((0, 0), 0.25, (0, TURN), slices)
    return extruded(circle, outward, path, frames)
