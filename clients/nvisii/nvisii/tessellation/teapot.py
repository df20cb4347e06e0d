"""The teapot that Martin Newell measured in 1975, as bicubic Bezier patches."""

from __future__ import annotations

from typing import Any

import numpy as np

from .surface import Surface, merged, of_grid, uv_grid

_ARC = 0.56  # of the radius: the handles of a quarter circle

# Rims, bodies, lids and bottoms: profiles of (radius, height), four points each, from above down.
_TURNED = (
    ((1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)),
    ((1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)),
    ((2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)),
    ((0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7)),
    ((0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)),
    ((1.5, 0.15), (1.5, 0.075), (1.425, 0.0), (0.0, 0.0)),
)
# Handle and spout: where their two seams run, (x, z) of four control points each; the patch bulges
# to the sides by the widths. Halves, which are mirrored in y.
_HANDLE = (
    (((-1.6, 2.025), (-1.5, 2.25)), ((-2.3, 2.025), (-2.5, 2.25)), ((-2.7, 2.025), (-3.0, 2.25)),
     ((-2.7, 1.8), (-3.0, 1.8))),
    (((-2.7, 1.8), (-3.0, 1.8)), ((-2.7, 1.575), (-3.0, 1.35)), ((-2.5, 1.125), (-2.65, 0.9375)),
     ((-2.0, 0.9), (-1.9, 0.6))),
)  # fmt: skip
_SPOUT = (
    (((1.7, 1.425), (1.7, 0.6)), ((2.6, 1.425), (3.1, 0.825)), ((2.3, 2.1), (2.4, 2.025)),
     ((2.7, 2.4), (3.3, 2.4))),
    (((2.7, 2.4), (3.3, 2.4)), ((2.8, 2.475), (3.525, 2.49375)), ((2.9, 2.475), (3.45, 2.5125)),
     ((2.8, 2.4), (3.2, 2.4))),
)  # fmt: skip
_WIDTHS = ((0.3, 0.3, 0.3, 0.3), (0.66, 0.66, 0.25, 0.25), (0.25, 0.25, 0.15, 0.15))


def teapot(segments: int) -> Surface:
    """Standing on z = 0, the spout towards +X; 32 patches of (segments + 1)^2 vertices."""
    parts = []
    for profile in _TURNED:
        quarter = _patch(_turned(np.array(profile)), segments)
        for turn in range(4):
            c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
            parts.append(quarter.placed([[c, -s, 0], [s, c, 0], [0, 0, 1]], (0, 0, 0)))
    bulges = zip((*_HANDLE, *_SPOUT), (_WIDTHS[0], _WIDTHS[0], *_WIDTHS[1:]))
    for seams, width in bulges:
        side = _patch(_bulging(np.array(seams), np.array(width)), segments)
        parts.append(side)
        mirrored = side.placed(np.diag([1, -1, 1]), (0, 0, 0))
        parts.append(mirrored._replace(indices=mirrored.indices[:, ::-1]))
    return merged(parts)


def _turned(profile: Any) -> Any:
    """(4, 4, 3) control points: down the profile, a quarter turn from +X to +Y."""
    radius, height = profile[:, :1], profile[:, 1:]
    x = radius * np.array([1, 1, _ARC, 0])
    y = radius * np.array([0, _ARC, 1, 1])
    return np.stack([x, y, np.broadcast_to(height, x.shape)], axis=-1)


def _bulging(seams: Any, widths: Any) -> Any:
    """(4, 4, 3) control points: along the seams, from the first seam by +Y to the second."""
    across = seams[:, [0, 0, 1, 1]]
    y = widths[:, None] * np.array([0, 1, 1, 0])
    return np.stack([across[..., 0], y, across[..., 1]], axis=-1)


def _patch(control: Any, segments: int) -> Surface:
    """Outside is where rows x columns of the control points point."""
    u, v = uv_grid(segments, segments)
    rows, columns = _bernstein(v), _bernstein(u)
    positions = np.einsum("ijr,ijc,rcx->ijx", rows[0], columns[0], control)
    down = np.einsum("ijr,ijc,rcx->ijx", rows[1], columns[0], control)
    along = np.einsum("ijr,ijc,rcx->ijx", rows[0], columns[1], control)
    normals = np.cross(down, along)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    degenerate = lengths < 1e-9  # the middle of the lid and of the bottom
    pole = (0.0, 0.0, 1.0 if control[0, 0, 2] > 1 else -1.0)
    normals = np.where(degenerate, pole, normals / np.maximum(lengths, 1e-9))
    surface = of_grid(positions, normals, (u, 1 - v))
    return surface._replace(indices=surface.indices[:, ::-1])


def _bernstein(t: Any) -> tuple[Any, Any]:
    """(..., 4) cubic basis and its derivative."""
    s = 1 - t
    value = np.stack([s**3, 3 * t * s**2, 3 * t**2 * s, t**3], axis=-1)
    slope = np.stack([-3 * s**2, 3 * s**2 - 6 * t * s, 6 * t * s - 3 * t**2, 3 * t**2], axis=-1)
    return value, slope
