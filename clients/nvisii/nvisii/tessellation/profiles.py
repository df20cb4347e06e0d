"""Closed sections of tubes: points (K, 2) counter-clockwise and their normals; corners twice."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .surface import TURN, arc_profile, line_profile


def circle(radius: float, segments: int) -> tuple[Any, Any]:
    """segments + 1 points, the first one again at the end."""
    return arc_profile((0, 0), radius, (0, TURN), segments)


def rectangle(size: Any, segments: Any, offset: float = 0.0) -> tuple[Any, Any]:
    """Four sides, each with its ends; offset: moves each outwards."""
    x, y = size
    sides = [
        line_profile((x + offset, -y), (x + offset, y), segments[1]),
        line_profile((x, y + offset), (-x, y + offset), segments[0]),
        line_profile((-x - offset, y), (-x - offset, -y), segments[1]),
        line_profile((-x, -y - offset), (x, -y - offset), segments[0]),
    ]
    return _joined(sides)


def rounded_rectangle(radius: float, size: Any, slices: int, segments: Any) -> tuple[Any, Any]:
    """Four sides and four quarters of circles."""
    points, normals = rectangle(size, segments, offset=radius)
    counts = [int(segments[1]) + 1, int(segments[0]) + 1] * 2
    ends = np.cumsum(counts)
    out = []
    for quarter, (begin, end) in enumerate(zip(ends - counts, ends)):
        out.append((points[begin:end], normals[begin:end]))
        sign_x, sign_y = ((1, 1), (-1, 1), (-1, -1), (1, -1))[quarter]
        angles = (quarter * math.pi / 2, (quarter + 1) * math.pi / 2)
        center = (sign_x * size[0], sign_y * size[1])
        out.append(arc_profile(center, radius, angles, slices))
    return _joined(out)


def _joined(parts: list[tuple[Any, Any]]) -> tuple[Any, Any]:
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])
