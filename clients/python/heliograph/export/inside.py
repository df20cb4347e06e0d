"""Replacement for light that travels inside bodies, in files that cannot describe it."""

from __future__ import annotations

import numpy as np

from .looks import Field, Look
from .world import World


def without_inside(world: World, look: Look) -> Look:
    """Look with subsurface_color mixed into base_color, by the share of light from inside."""
    share = look.number("subsurface")
    base, inside = look["base_color"], look["subsurface_color"]
    if share == 0 or base.use or inside.use:
        return look
    world.notes.add(look.name, "subsurface_color is mixed into base_color")
    mixed = np.multiply(base.value, 1 - share) + np.multiply(inside.value, share)
    return look.with_fields(base_color=Field(tuple(mixed.tolist())))
