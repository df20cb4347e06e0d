"""The materials that bench/materials_beside.py compares, in the terms of each renderer. No imports
beyond Python's own: all three renderers' Pythons read it.

GGX alpha is roughness^2 everywhere. Mitsuba: dicts of plugins. Cycles: a shader node, its
properties and inputs, and perhaps a volume node.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Values = dict[str, Any]
ONCE = "Mitsuba: scatters once, so loses light; Smith's shadowing uncorrelated"
ROUGH_GLASS = ONCE + ". Cycles: some light lost inside; by lamps too bright where very rough"
METAL = ONCE + ". Cycles: multiple scattering in the highlight, ours in all directions"
COAT = "exact Fresnel there, Schlick's here. " + ONCE
PASSAGES = ("reflects", "refracts", "reflects inside", "refracts outwards")
SOLID = ("dome", "lamp")
CLEAR = ("dome", "lamp", "back")


@dataclass(frozen=True)
class Row:
    """A material; None: the renderer has no such. why: what makes the models differ by design."""

    name: str
    ours: Values
    mitsuba: Values | None
    cycles: Values | None
    lights: tuple[str, ...] = SOLID
    why: str = ""


def core_scale(row: Row, light: str) -> float:
    """Times the core's radiance where radiance is scaled as it refracts (Cycles does not): so that
    pictures show the share of light that passes."""
    if row.ours.get("thin_walled"):
        return 1
    square: float = row.ours.get("ior", 1) ** 2
    return {"refracts": square, "refracts outwards": 1 / square}.get(light, 1)


def rgb(*color: float) -> Values:
    return {"type": "rgb", "value": list(color) if len(color) > 1 else color[0]}


def node(name: str, properties: Values | None = None, **inputs: Any) -> Values:
    """inputs: names with _ for blanks."""
    named = {key.replace("_", " "): value for key, value in inputs.items()}
    return {"node": "ShaderNode" + name, "properties": properties or {}, "inputs": named}


def principled(**inputs: Any) -> Values:
    return node("BsdfPrincipled", {"distribution": "MULTI_GGX"}, **inputs)


def _glass(roughness: float, ior: float, lights: tuple[str, ...] = CLEAR) -> Row:
    theirs: Values = {"type": "dielectric", "int_ior": ior, "ext_ior": 1.0}
    if roughness > 0:
        theirs |= {"type": "roughdielectric", "distribution": "ggx", "alpha": roughness**2}
    cycles = node(
        "BsdfGlass", {"distribution": "MULTI_GGX"}, Color=(1, 1, 1, 1), Roughness=roughness, IOR=ior
    )
    return Row(
        f"glass {roughness:g} ior {ior:g}",
        {"base_color": 1, "transmission": 1, "roughness": roughness, "ior": ior},
        theirs,
        cycles,
        lights,
        ROUGH_GLASS if roughness > 0 else "",
    )


def _tinted_glass() -> Row:
    color = (0.9, 0.5, 0.2)
    return Row(
        "glass, coloured",
        {"base_color": color, "transmission": 1, "roughness": 0, "ior": 1.5},
        {
            "type": "dielectric",
            "int_ior": 1.5,
            "ext_ior": 1.0,
            "specular_transmittance": rgb(*map(math.sqrt, color)),
        },
        principled(Base_Color=(*color, 1), Roughness=0, IOR=1.5, Transmission_Weight=1),
        CLEAR,
    )


GOLD = (1.0, 0.71, 0.29)


def _metal(roughness: float, color: tuple[float, ...] = GOLD, anisotropic: float = 0) -> Row:
    name = f"metal {roughness:g}" + (" white" if min(color) == 1 else "")
    return Row(
        name + (f" anisotropic {anisotropic:g}" if anisotropic else ""),
        {"base_color": color, "metallic": 1, "roughness": roughness, "anisotropic": anisotropic},
        {
            "type": "principled",
            "base_color": rgb(*color),
            "metallic": 1.0,
            "roughness": roughness,
            "anisotropic": anisotropic,
        },
        principled(
            Base_Color=(*color, 1), Metallic=1, Roughness=roughness, Anisotropic=anisotropic
        ),
        why=METAL,
    )


RED = (0.6, 0.2, 0.1)


def _plastic(roughness: float) -> Row:
    theirs: Values = {
        "type": "plastic",
        "diffuse_reflectance": rgb(*RED),
        "int_ior": 1.5,
        "ext_ior": 1.0,
        "nonlinear": False,
    }
    if roughness > 0:
        theirs |= {"type": "roughplastic", "distribution": "ggx", "alpha": roughness**2}
    return Row(
        f"plastic {roughness:g}",
        {"base_color": RED, "roughness": roughness, "ior": 1.5},
        theirs,
        principled(Base_Color=(*RED, 1), Roughness=roughness, IOR=1.5),
        why=COAT,
    )


def _burley_plastic() -> Row:
    return Row(
        "plastic 0.6 beside principled",
        {"base_color": RED, "roughness": 0.6, "ior": 1.5},
        {"type": "principled", "base_color": rgb(*RED), "roughness": 0.6, "eta": 1.5},
        None,
        why="Mitsuba: Burley's diffuse, brighter at the rim; the coat takes nothing from it",
    )


def _clearcoat(roughness: float, color: tuple[float, float, float]) -> Row:
    return Row(
        f"clearcoat {roughness:g} on " + ("red" if max(color) > 0 else "black"),
        {
            "base_color": color,
            "specular": 0,
            "clearcoat": 1,
            "clearcoat_roughness": roughness,
        },
        {
            "type": "roughplastic",
            "diffuse_reflectance": rgb(*color),
            "int_ior": 1.5,
            "ext_ior": 1.0,
            "nonlinear": False,
            "distribution": "ggx",
            "alpha": roughness**2,
        },
        principled(
            Base_Color=(*color, 1),
            Specular_IOR_Level=0,
            Coat_Weight=1,
            Coat_Roughness=roughness,
            Coat_IOR=1.5,
        ),
        why=COAT + ". The clearcoat here scatters once too",
    )


def _sheen(roughness: float) -> Row:
    return Row(
        f"sheen {roughness:g} on black",
        {"base_color": 0, "specular": 0, "sheen": 1, "sheen_roughness": roughness},
        {
            "type": "principled",
            "base_color": rgb(0.0),
            "specular": 0.0,
            "roughness": 1.0,
            "sheen": 1.0,
        },
        node("BsdfSheen", {"distribution": "MICROFIBER"}, Color=(1, 1, 1, 1), Roughness=roughness),
        why="three models: Conty and Kulla; Burley (no roughness); Zeltner et al., by a table",
    )


def _sheet(roughness: float) -> Row:
    theirs: Values = {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0}
    if roughness > 0:
        theirs = {
            "type": "principledthin",
            "base_color": rgb(1.0),
            "roughness": roughness,
            "spec_trans": 1.0,
            "eta": 1.5,
        }
    return Row(
        f"thin-walled {roughness:g}",
        {
            "base_color": 1,
            "transmission": 1,
            "roughness": roughness,
            "ior": 1.5,
            "thin_walled": True,
        },
        theirs,
        None,
        (*CLEAR, "reflects", "refracts"),
        "Mitsuba: roughness of what passes scaled by the index (Burley 2015)" if roughness else "",
    )


def _absorbing() -> Row:
    color, density = (0.3, 0.6, 0.9), 2.0
    sigma = [-math.log(c) for c in color]
    cycles = node(
        "BsdfGlass", {"distribution": "MULTI_GGX"}, Color=(1, 1, 1, 1), Roughness=0, IOR=1.5
    )
    cycles["volume"] = node(
        "VolumeAbsorption", Color=(*(1 - s / density for s in sigma), 1), Density=density
    )
    return Row(
        "glass, absorbing",
        {
            "base_color": 1,
            "transmission": 1,
            "roughness": 0,
            "ior": 1.5,
            "attenuation_color": color,
            "attenuation_distance": 1,
        },
        {
            "type": "dielectric",
            "int_ior": 1.5,
            "ext_ior": 1.0,
            "interior": {
                "type": "homogeneous",
                "albedo": 0.0,
                "sigma_t": rgb(*(s / density for s in sigma)),
                "scale": density,
            },
        },
        cycles,
        CLEAR,
    )


def _subsurface(radius: float) -> Row:
    color = (0.8, 0.5, 0.3)
    return Row(
        f"subsurface {radius:g}",
        {
            "base_color": color,
            "specular": 0,
            "subsurface": 1,
            "subsurface_color": color,
            "subsurface_radius": radius,
        },
        None,
        node(
            "BsdfPrincipled",
            {"subsurface_method": "RANDOM_WALK"},
            Base_Color=(*color, 1),
            Specular_IOR_Level=0,
            Subsurface_Weight=1,
            Subsurface_Scale=4 * math.pi * radius,  # Cycles divides it by 4 pi
            Subsurface_Radius=(1, 1, 1),
        ),
        CLEAR,
    )


def _diffuse() -> Row:
    return Row(
        "diffuse",
        {"base_color": RED, "specular": 0},
        {"type": "diffuse", "reflectance": rgb(*RED)},
        node("BsdfDiffuse", Color=(*RED, 1), Roughness=0),
    )


def _translucent() -> Row:
    return Row(
        "translucent",
        {
            "base_color": 0,
            "specular": 0,
            "diffuse_transmission": 1,
            "diffuse_transmission_color": RED,
            "thin_walled": True,
        },
        {
            "type": "principledthin",
            "base_color": rgb(*RED),
            "diff_trans": 2.0,
            "roughness": 0.5,
        },
        node("BsdfTranslucent", Color=(*RED, 1)),
        CLEAR,
        "Mitsuba: Burley's diffuse, darker at the rim",
    )


ROWS = (
    _diffuse(),
    *(_glass(r, 1.5, (*CLEAR, *PASSAGES)) for r in (0, 0.1, 0.3, 0.5, 0.8)),
    *(_glass(r, ior, ("dome", *PASSAGES)) for ior in (1.33, 2.0) for r in (0.3, 0.8)),
    _tinted_glass(),
    _absorbing(),
    _translucent(),
    _sheet(0),
    _sheet(0.3),
    *(_metal(r) for r in (0.2, 0.4, 0.6, 0.8)),
    _metal(0.8, (1.0, 1.0, 1.0)),
    _metal(0.4, GOLD, 0.8),
    *(_plastic(r) for r in (0, 0.1, 0.3, 0.6)),
    _burley_plastic(),
    *(_clearcoat(r, (0.0, 0.0, 0.0)) for r in (0.1, 0.4)),
    _clearcoat(0.1, RED),
    *(_sheen(r) for r in (0.3, 0.6)),
    *(_subsurface(r) for r in (0.01, 0.1)),
)


def pictures(names: list[str]) -> Iterator[tuple[Row, str]]:
    """Yields each material under each of its lights. names: of materials; none: all of them."""
    for row in ROWS:
        if not names or row.name in names:
            for light in row.lights:
                yield row, light
