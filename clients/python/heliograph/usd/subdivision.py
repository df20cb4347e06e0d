"""Catmull-Clark subdivision of polygons, with creases as OpenSubdiv has them.

Rules: Catmull and Clark 1978; of creases and their sharpness: DeRose, Kass and Truong 1998. Values
at corners (faceVarying) are interpolated linearly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._wire.arrays import NdArray


@dataclass(frozen=True)
class Sharp:
    """Creases: (E, 2) points of edges and (E,) their sharpness; corners: (P,) that of points."""

    edges: NdArray
    edge_sharpness: NdArray
    corners: NdArray


class Cage:
    """Polygons and one step of their subdivision: to one quad a corner.

    points: their number P. counts: (F,) corners of each face. indices: (N,) points of the corners.
    """

    def __init__(self, points: int, counts: NdArray, indices: NdArray, sharp: Sharp) -> None:
        self.points, self.counts, self.indices = points, counts, indices
        starts = np.repeat(np.cumsum(counts) - counts, counts)
        place = np.arange(len(indices)) - starts
        size = np.repeat(counts, counts)
        self.ahead = starts + (place + 1) % size  # (N,) the next corner of the face
        self.behind = starts + (place - 1) % size
        self.face = np.repeat(np.arange(len(counts)), counts)
        keys = self._keys(np.stack([indices, indices[self.ahead]], axis=-1))
        self.edge_keys, self.edge = np.unique(keys, return_inverse=True)
        self.edges = np.stack([self.edge_keys // points, self.edge_keys % points], axis=-1)
        self.faces_at = np.bincount(self.edge, minlength=len(self.edges))
        self.sharpness = self._sharpness(sharp)
        self.corners = sharp.corners

    def _keys(self, pairs: NdArray) -> NdArray:
        return np.asarray(pairs.min(axis=-1) * self.points + pairs.max(axis=-1))

    def _sharpness(self, sharp: Sharp) -> NdArray:
        """(E,) infinite along borders."""
        found = np.where(self.faces_at == 2, 0.0, np.inf)
        keys = self._keys(sharp.edges)
        place = np.minimum(np.searchsorted(self.edge_keys, keys), len(self.edge_keys) - 1)
        known = self.edge_keys[place] == keys
        np.maximum.at(found, place[known], sharp.edge_sharpness[known])
        return found

    def quads(self) -> NdArray:
        """(N, 4) points of the quads: a corner, the next edge, the face, the edge before."""
        edges, faces = self.points + self.edge, self.points + len(self.edges) + self.face
        return np.stack([self.indices, edges, faces, edges[self.behind]], axis=-1)

    def next(self) -> Cage:
        """The cage of the quads."""
        count = self.points + len(self.edges) + len(self.counts)
        middles = self.points + np.arange(len(self.edges))
        halves = np.concatenate([np.stack([self.edges[:, i], middles], axis=-1) for i in (0, 1)])
        less = np.maximum(self.sharpness - 1, 0)
        corners = np.zeros(count)
        corners[: self.points] = np.maximum(self.corners - 1, 0)
        quads = self.quads()
        sharp = Sharp(halves, np.tile(less, 2), corners)
        return Cage(count, np.full(len(quads), 4), quads.ravel(), sharp)

    # ------------------------------------------------------------ values

    def at_corners(self, values: NdArray) -> NdArray:
        """(4 N, W) values at the quads' corners, of (N, W) at the corners of faces."""
        ahead = 0.5 * (values + values[self.ahead])
        middle = self._sum(self.face, values, len(self.counts)) / self.counts[:, None]
        quads = np.stack([values, ahead, middle[self.face], ahead[self.behind]], axis=1)
        return quads.reshape(-1, values.shape[1])

    def at_points(self, values: NdArray) -> NdArray:
        """(P + E + F, W) values at the quads' points, of (P, W)."""
        faces = self._sum(self.face, values[self.indices], len(self.counts))
        faces /= np.maximum(self.counts, 1)[:, None]
        middles = 0.5 * (values[self.edges[:, 0]] + values[self.edges[:, 1]])
        return np.concatenate(
            [self._points(values, faces, middles), self._edges(faces, middles), faces]
        )

    def _sum(self, groups: NdArray, values: NdArray, count: int) -> NdArray:
        out = np.zeros((count, values.shape[1]))
        np.add.at(out, groups, values)
        return out

    def _edges(self, faces: NdArray, middles: NdArray) -> NdArray:
        sums = self._sum(self.edge, faces[self.face], len(self.edges))
        smooth = (2 * middles + sums) / (2 + self.faces_at)[:, None]
        return _mixed(smooth, middles, np.minimum(self.sharpness, 1))

    def _points(self, values: NdArray, faces: NdArray, middles: NdArray) -> NdArray:
        smooth = self._smooth(values, faces, middles)
        ends = self.edges.ravel()
        share = np.repeat(np.minimum(self.sharpness, 1), 2)
        is_sharp = share > 0
        count = np.bincount(ends[is_sharp], minlength=self.points)
        weight = np.bincount(ends, share, self.points) / np.maximum(count, 1)
        others = values[self.edges[:, ::-1].ravel()]
        crease = 0.75 * values + 0.125 * self._sum(ends[is_sharp], others[is_sharp], self.points)
        out = _mixed(smooth, crease, np.where(count == 2, weight, 0))
        out = _mixed(out, values, np.where(count > 2, weight, 0))
        return _mixed(out, values, np.minimum(self.corners, 1))

    def _smooth(self, values: NdArray, faces: NdArray, middles: NdArray) -> NdArray:
        """(F + 2 R + (n - 3) P) / n of means F of faces' and R of edges' middles about a point."""
        ends = self.edges.ravel()
        n = np.bincount(ends, minlength=self.points)[:, None]
        about = np.bincount(self.indices, minlength=self.points)[:, None]
        f = self._sum(self.indices, faces[self.face], self.points) / np.maximum(about, 1)
        r = self._sum(ends, np.repeat(middles, 2, axis=0), self.points) / np.maximum(n, 1)
        return np.where(n > 0, (f + 2 * r + (n - 3) * values) / np.maximum(n, 1), values)


def _mixed(a: NdArray, b: NdArray, share: NdArray) -> NdArray:
    return np.asarray(a + (b - a) * share[:, None])


class Refinement:
    """Refinement of a cage, in one step or more. points: their number. faces: (Q,) face of the cage
    of each quad. indices: (4 Q,) points of the quads."""

    def __init__(self, cage: Cage, levels: int) -> None:
        self.cages = [cage]
        self.faces = cage.face
        for _ in range(levels - 1):
            self.cages.append(self.cages[-1].next())
            self.faces = self.faces[self.cages[-1].face]
        self.indices = self.cages[-1].quads().ravel()

    def at_points(self, values: NdArray) -> NdArray:
        """(P', W) values at the quads' points, of (P, W) at the cage's."""
        for cage in self.cages:
            values = cage.at_points(values)
        return values

    def at_corners(self, values: NdArray) -> NdArray:
        """(4 Q, W) values at the quads' corners, of (N, W) at those of the cage's faces."""
        for cage in self.cages:
            values = cage.at_corners(values)
        return values
