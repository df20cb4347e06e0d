"""Points uniform over the part of a surface that things can stand on. Used by scatter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import FailedPrecondition

if TYPE_CHECKING:
    from ..draw import Draw

_TRIES = 10_000


class Surface:
    """The triangles of some entities, as drawn so far, that face up within an angle.

    corners: (T, 3, 3) world. normals: (T, 3). areas: (T,) square metres.
    """

    def __init__(self, draw: Draw, entities: Any, max_slope: float) -> None:
        parts = []
        for body in draw.bodies.some(entities, "on"):
            parts.append(body.world(draw.pose(body.root))[body.triangles])
        corners = np.concatenate(parts)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(cross, axis=1)
        keep = cross[:, 2] > np.maximum(1e-12, math.cos(max_slope) * twice)
        if not keep.any():
            raise FailedPrecondition(
                "on: no part of that surface faces up within max_slope of +Z; turn it or raise "
                "max_slope",
            )
        self.corners: NdArray = corners[keep]
        self.normals: NdArray = cross[keep] / twice[keep, None]
        self.areas: NdArray = 0.5 * twice[keep]
        middles = self.corners.mean(axis=1)
        self.middle: NdArray = (self.areas[:, None] * middles).sum(axis=0) / self.areas.sum()

    def within(self, around: NdArray, radius: float) -> Patch:
        """Its part in a ball."""
        return Patch(self, around, radius)

    def carries(self, points: NdArray, tolerance: float) -> bool:
        """True if each point (N, 3) lies on the surface, within `tolerance` metres along the
        normal."""
        a, b, c = self.corners.transpose(1, 0, 2)
        to = points[:, None, :] - a
        off = np.abs(np.einsum("ntk,tk->nt", to, self.normals)) <= tolerance
        u, v = _barycentric(to, b - a, c - a)
        slack = 1e-6
        inside = (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack)
        return bool((off & inside).any(axis=1).all())


class Patch:
    """The part of a Surface in a ball; radius may be infinite.

    A point is drawn from a triangle, or from the disc that the ball cuts from its plane, whichever
    is smaller, in proportion to that area, and refused outside the other: so the density is
    uniform, and few are refused however large the triangles are.
    """

    def __init__(self, surface: Surface, around: NdArray, radius: float) -> None:
        height = np.einsum("tk,tk->t", around - surface.corners[:, 0], surface.normals)
        disc = np.maximum(0, radius**2 - height**2)
        far = _gap(surface.corners, around) > radius
        areas = np.where(far, 0, np.minimum(surface.areas, math.pi * disc))
        if areas.sum() <= 0:
            raise FailedPrecondition(
                f"radius: the surface has nothing to stand on within {radius:g} m of "
                f"{np.round(around, 3).tolist()}; give around= or another radius="
            )
        self._surface, self._around, self._radius = surface, around, radius
        self._from_disc = math.pi * disc < surface.areas
        self._disc = np.sqrt(disc)
        self._foot = around - height[:, None] * surface.normals
        self._sums = np.cumsum(areas)

    def point(self, rng: np.random.Generator) -> tuple[NdArray, NdArray]:
        """(3,) point and (3,) normal."""
        for _ in range(_TRIES):
            t = int(np.searchsorted(self._sums, rng.random() * self._sums[-1], side="right"))
            a, b, c = self._surface.corners[t]
            normal = self._surface.normals[t]
            u, v = rng.random(2)
            if self._from_disc[t]:
                first = (b - a) / np.linalg.norm(b - a)
                second = np.cross(normal, first)
                angle, length = 2 * math.pi * u, self._disc[t] * math.sqrt(v)
                point = self._foot[t] + length * (
                    math.cos(angle) * first + math.sin(angle) * second
                )
                s, w = _barycentric(point - a, b - a, c - a)
                accepted = s >= 0 and w >= 0 and s + w <= 1
            else:
                root = math.sqrt(u)
                point = (1 - root) * a + root * (1 - v) * b + root * v * c
                accepted = float(np.linalg.norm(point - self._around)) <= self._radius
            if accepted:
                return point, normal
        raise FailedPrecondition("radius: hardly anything of the surface lies in it; give a larger")


def _gap(corners: NdArray, point: NdArray) -> NdArray:
    """(T,) metres from a point to the triangles' boxes."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    gap = np.maximum(0, np.maximum(low - point, point - high))
    return np.asarray(np.linalg.norm(gap, axis=1))


def _barycentric(to: NdArray, e1: NdArray, e2: NdArray) -> tuple[Any, Any]:
    """Weights of the second and third corner; to: from the first corner to the point."""
    d11, d12, d22 = (np.sum(p * q, axis=-1) for p, q in ((e1, e1), (e1, e2), (e2, e2)))
    p1, p2 = np.sum(to * e1, axis=-1), np.sum(to * e2, axis=-1)
    scale = d11 * d22 - d12 * d12
    return (d22 * p1 - d12 * p2) / scale, (d11 * p2 - d12 * p1) / scale
