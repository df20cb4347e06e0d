"""Bundled materials, as the keyword arguments of edit.material(): **hg.materials.steel.

matte, plaster, plastic, rubber, wood, steel, aluminium, gold, copper, chrome, glass, frosted_glass,
marble, skin, milk.

Reflectances of metals: RGB of measured n and k (RefractiveIndex.INFO), rounded. Marble, skin and
milk: Jensen et al. 2001, "A Practical Model for Subsurface Light Transport", figure 5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..scene.patches import Parameters

matte: Parameters = {"base_color": 0.6, "roughness": 1.0, "specular": 0.0}
plaster: Parameters = {"base_color": (0.78, 0.76, 0.72), "roughness": 0.9}
plastic: Parameters = {"base_color": (0.05, 0.2, 0.6), "roughness": 0.25}
rubber: Parameters = {"base_color": 0.03, "roughness": 0.75}
wood: Parameters = {"base_color": (0.38, 0.22, 0.12), "roughness": 0.55}
steel: Parameters = {"base_color": (0.56, 0.57, 0.58), "metallic": 1.0, "roughness": 0.25}
aluminium: Parameters = {"base_color": (0.91, 0.92, 0.92), "metallic": 1.0, "roughness": 0.3}
gold: Parameters = {"base_color": (1.0, 0.77, 0.34), "metallic": 1.0, "roughness": 0.15}
copper: Parameters = {"base_color": (0.95, 0.64, 0.54), "metallic": 1.0, "roughness": 0.2}
chrome: Parameters = {"base_color": (0.55, 0.55, 0.55), "metallic": 1.0, "roughness": 0.03}
glass: Parameters = {"base_color": 1.0, "transmission": 1.0, "roughness": 0.0, "ior": 1.5}
frosted_glass: Parameters = {"base_color": 1.0, "transmission": 1.0, "roughness": 0.35}
marble: Parameters = {
    "subsurface": 1.0,
    "subsurface_color": (0.83, 0.79, 0.75),
    "subsurface_radius": (0.46e-3, 0.38e-3, 0.33e-3),
    "roughness": 0.3,
}
skin: Parameters = {
    "subsurface": 1.0,
    "subsurface_color": (0.44, 0.22, 0.13),
    "subsurface_radius": (1.3e-3, 0.95e-3, 0.67e-3),
    "ior": 1.3,
    "roughness": 0.45,
}
milk: Parameters = {
    "subsurface": 1.0,
    "subsurface_color": (0.91, 0.88, 0.76),
    "subsurface_radius": (0.39e-3, 0.31e-3, 0.26e-3),
    "ior": 1.3,
    "roughness": 0.0,
}

names = tuple(
    name for name, value in list(globals().items()) if isinstance(value, dict) and name[0] != "_"
)
