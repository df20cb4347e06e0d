"""Textures of six faces, one below the other: +x, -x, +y, -y, +z, -z, as OpenGL has them.

Source: OpenGL 4.6 core profile, table 8.19 (which face a direction meets, and where).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..._wire.arrays import NdArray

# Axis and sign of each face, and rows that give s and t of a direction.
_S = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [1, 0, 0], [1, 0, 0], [-1, 0, 0]], "f8")
_T = np.array([[0, -1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0], [0, -1, 0]], "f8")


def face_of(directions: NdArray) -> NdArray:
    """(...,): which of the six faces a direction (..., 3) meets."""
    axis = np.abs(directions).argmax(axis=-1)
    along = np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0]
    return np.asarray(2 * axis + (along < 0))


def place_on(face: NdArray, directions: NdArray) -> NdArray:
    """(..., 2): to the right and down in [0, 1] on a face, of directions (..., 3)."""
    along = np.abs(np.take_along_axis(directions, (face // 2)[..., None], axis=-1))
    s, t = ((rows[face] * directions).sum(-1, keepdims=True) for rows in (_S, _T))
    return np.asarray(0.5 * np.concatenate([s, t], axis=-1) / along + 0.5)


def looked_up(texels: NdArray, directions: NdArray) -> NdArray:
    """(..., C): the nearest texels of a cube (6 n, n, C), or (n, n, C) for six equal faces."""
    n = texels.shape[1]
    face = face_of(directions)
    right, down = np.moveaxis(np.clip(place_on(face, directions) * n, 0, n - 1).astype(int), -1, 0)
    first = n * face if texels.shape[0] >= 6 * n else 0
    return np.asarray(texels[first + down, right])


def lat_long(texels: NdArray, turned: Callable[[NdArray], NdArray], height: int = 512) -> NdArray:
    """Picture (height, 2 height, C) for edit.dome(). turned: rotates directions to those of the
    cube."""
    phi = 2 * np.pi * (0.5 - (np.arange(2 * height) + 0.5) / (2 * height))
    theta = np.pi * (np.arange(height)[:, None] + 0.5) / height
    directions = np.stack(
        [
            np.sin(theta) * np.cos(phi),
            np.sin(theta) * np.sin(phi),
            np.broadcast_to(np.cos(theta), (height, 2 * height)),
        ],
        axis=-1,
    )
    return looked_up(texels, turned(directions))


# ------------------------------------------------------------ on meshes

_FEW = 500  # triangles; so few are large, and a picture of six faces is bent on them
_HALVES = np.array(
    [[[2, 0, 0], [1, 1, 0], [1, 0, 1]], [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
     [[1, 0, 1], [0, 1, 1], [0, 0, 2]], [[1, 1, 0], [0, 1, 1], [1, 0, 1]]]
) / 2  # fmt: skip  # of a triangle: four, by the weights of its corners


def wrapped(corners: NdArray, scale: NdArray, size: tuple[int, int]) -> tuple[NdArray, NdArray]:
    """Cuts triangles where the faces of a cube about the origin meet; (T, 3, K) corners whose first
    three numbers are positions, and (T, 3, 2) texture coordinates on the faces one below the other.
    scale: of positions to the cube's directions. size: faces, and texels along the side of one."""
    faces, side = size
    if len(corners) < _FEW:
        for _ in range(2):
            corners = np.einsum("qij,tjk->tqik", _HALVES, corners).reshape(-1, 3, corners.shape[2])
    for a, b in ((0, 1), (1, 2), (2, 0)):
        for sign in (1, -1):
            heights = corners[..., a] * scale[a] - sign * corners[..., b] * scale[b]
            corners = _cut(corners, heights)
    directions = corners[..., :3] * scale
    face = np.repeat(face_of(directions.mean(1))[:, None], 3, axis=1)
    inset = 0.5 / side
    right, down = np.moveaxis(np.clip(place_on(face, directions), inset, 1 - inset), -1, 0)
    return corners, np.stack([right, 1 - (face % faces + down) / faces], axis=-1)


def _cut(corners: NdArray, heights: NdArray) -> NdArray:
    """Triangles (T, 3, K) cut where their heights (T, 3) are 0."""
    heights = np.where(np.abs(heights) < 1e-9, 0.0, heights)
    crossed = (heights.min(1) < 0) & (heights.max(1) > 0)
    found, level = corners[crossed], heights[crossed]
    positive = level > 0
    is_lone = positive == (positive.sum(1) == 1)[:, None]
    order = (is_lone.argmax(1)[:, None] + np.arange(3)) % 3
    found = np.take_along_axis(found, order[..., None], axis=1)
    level = np.take_along_axis(level, order, axis=1)
    a, b, c = np.moveaxis(found, 1, 0)
    share = level[:, :1] / (level[:, :1] - level[:, 1:])
    ab, ac = (a + share[:, i : i + 1] * (other - a) for i, other in enumerate((b, c)))
    pieces = [(a, ab, ac), (ab, b, c), (ab, c, ac)]
    return np.concatenate([corners[~crossed], *(np.stack(piece, axis=1) for piece in pieces)])
