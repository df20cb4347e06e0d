"""An nvisii material in the daemon's terms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import heliograph as hg

from .materials import material

# Ranges that the daemon takes; values beyond are cut off.
_RANGES = {"ior": (1.0, 4.0), "subsurface_radius": (0.0, 1e6)}
_OPAQUE_IOR = 1.5  # reflects 0.04; specular 0.5 asks for 0.08 * 0.5


def material_arguments(found: material, ref: Callable[[Any], Any]) -> dict[str, Any]:
    """The keyword arguments of Edits.material. ref: the handle of a texture."""
    out = {name: _clipped(name, value) for name, value in found._values.items()}
    transmits = out["transmission"]
    out["specular_color"] = 2.0 + (1.0 - 2.0) * transmits
    out["specular"] += (1.0 - out["specular"]) * transmits
    if transmits == 0 and "transmission" not in found._textures:
        out["ior"] = _OPAQUE_IOR
    blends = found._values["alpha"] < 1 or "alpha" in found._textures
    out["alpha_mode"] = "blend" if blends else "opaque"
    for name, (image, channel) in found._textures.items():
        out[name] = hg.Tex(ref(image), channel=channel, uv=image._uv())
    normal = found._normal_map
    out["normal_map"] = None if normal is None else hg.Tex(ref(normal), uv=normal._uv())
    return out


def _clipped(name: str, value: Any) -> Any:
    low, high = _RANGES.get(name, (0.0, 1.0))
    if isinstance(value, tuple):
        return tuple(min(max(v, low), high) for v in value)
    return min(max(value, low), high)
