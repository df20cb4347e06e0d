"""Looks to materials of glTF. Source: glTF 2.0, 3.9, and the KHR_materials_* extensions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..._wire._proto import scene_pb2 as pb
from ..emission import Emission, lit
from ..inside import without_inside
from ..looks import Field, Look, look_of
from ..world import World
from .document import Document
from .textures import Textures, scaled

# Parameters that glTF has none for, and their value without effect.
_LEFT_OUT: Mapping[str, float] = {
    **{"subsurface": 0, "specular_tint": 0, "transmission_roughness": 0, "sheen_tint": 0},
    "medium_density": 0,
}
_MODES = {"opaque": "OPAQUE", "mask": "MASK", "blend": "BLEND"}


class Materials:
    """Puts materials into a document, each once."""

    def __init__(self, world: World, document: Document, textures: Textures) -> None:
        self.world = world
        self.document = document
        self.textures = textures
        self._made: dict[Any, int] = {}

    def of(self, key: int | None, emission: Emission | None, thickness: float) -> int:
        """The index of a material, or of the default one, that gives off light besides its own.

        thickness: metres through its mesh, for programs that do not measure that.
        """
        known = key, emission
        if known not in self._made:
            self._made[known] = self._make(self._look(key), emission, thickness)
        return self._made[known]

    def _look(self, key: int | None) -> Look:
        if key is None:
            return look_of(self.world, "default", pb.Material())
        shared = self.world.shared[key]
        return look_of(self.world, shared.name or f"material {key}", shared.message)

    def _make(self, look: Look, emission: Emission | None, thickness: float) -> int:
        shown = look if emission is None else lit(self.world, look, emission)
        return self.document.add("materials", _Writer(self, shown).made(thickness))


class _Writer:
    """Writer of one material."""

    def __init__(self, materials: Materials, look: Look) -> None:
        self.world = materials.world
        self.document = materials.document
        self.textures = materials.textures
        self.look = without_inside(materials.world, look)
        self.extensions: dict[str, Any] = {}

    def made(self, thickness: float) -> dict[str, Any]:
        out: dict[str, Any] = {"name": self.look.name}
        out["pbrMetallicRoughness"] = self._base()
        out.update(self._alpha(), **self._emission())
        if self._backs(thickness):
            out["doubleSided"] = True
        if "normal_map" in self.look.maps:
            use = self.look.maps["normal_map"]
            out["normalTexture"] = self.textures.normal_map(self.look.name, use)
        self._extend(thickness)
        if self.extensions:
            out["extensions"] = dict(sorted(self.extensions.items()))
        self._note_rest()
        return out

    # ------------------------------------------------------------ the core

    def _base(self) -> dict[str, Any]:
        parts = {"rgb": self.look["base_color"]}
        if self.look.alpha_mode != "opaque":
            parts["a"] = self.look["alpha"]
        info, factors = self.textures.packed(self.look.name, parts, srgb=True)
        out: dict[str, Any] = {
            "baseColorFactor": [*_numbers(factors["rgb"]), _unit(factors.get("a", 1.0))]
        }
        if info:
            out["baseColorTexture"] = info
        out.update(self._metal())
        return out

    def _metal(self) -> dict[str, Any]:
        parts = {"g": self._across(), "b": self.look["metallic"]}
        info, factors = self.textures.packed(self.look.name, parts)
        out = {"metallicFactor": _unit(factors["b"]), "roughnessFactor": _unit(factors["g"])}
        return {**out, "metallicRoughnessTexture": info} if info else out

    def _across(self) -> Field:
        """Roughness across the tangent; anisotropy stretches it in proportion to its mean."""
        rough, whole = self.look["roughness"], self._mean("roughness")
        if self.look["anisotropic"].is_zero:
            return rough
        if rough.use is not None:
            self.world.notes.add(self.look.name, "anisotropy is that of the mean roughness")
        a = math.sqrt(1 - 0.9 * min(self._constant("anisotropic"), 1.0))
        across, along = whole**2 * a, min(whole**2 / a, 1.0)
        self._extension(
            "KHR_materials_anisotropy",
            anisotropyStrength=math.sqrt(max(along - across, 0) / max(1 - across, 1e-6)),
            anisotropyRotation=2 * math.pi * self._constant("anisotropic_rotation"),
        )
        return Field(rough.value * math.sqrt(a), rough.use)

    def _alpha(self) -> dict[str, Any]:
        mode = self.look.alpha_mode
        out: dict[str, Any] = {} if mode == "opaque" else {"alphaMode": _MODES[mode]}
        if mode == "mask":
            out["alphaCutoff"] = self.look.alpha_cutoff
        return out

    def _emission(self) -> dict[str, Any]:
        if not self.look.emits:
            return {}
        strength = self._constant("emission_strength")
        color, most = scaled(self.look["emission"])
        info, factors = self.textures.packed(self.look.name, {"rgb": color}, srgb=True, peak=True)
        factor = np.asarray(factors["rgb"], dtype="f8") * np.ones(3)
        peak = max(1.0, float(factor.max()))
        level = strength * most * peak
        if level <= 1:
            factor, level = factor * level, 1.0
        out: dict[str, Any] = {"emissiveFactor": _numbers(factor / peak)}
        if level != 1:
            self._extension("KHR_materials_emissive_strength", emissiveStrength=level)
        return {**out, "emissiveTexture": info} if info else out

    def _backs(self, thickness: float) -> bool:
        """doubleSided: True if the back emits, for an emitter; else if the back is visible."""
        if self.look.emits:
            return self.look.two_sided_emission
        return not self._is_solid()

    # ------------------------------------------------------------ extensions

    def _extension(self, name: str, **values: Any) -> None:
        self.extensions[self.document.extension(name)] = values

    def _extend(self, thickness: float) -> None:
        look = self.look
        if look.unlit:
            self._extension("KHR_materials_unlit")
        if look.number("ior") != 1.5 or look["ior"].use:
            self._extension("KHR_materials_ior", ior=self._constant("ior"))
        self._specular()
        self._transmission(thickness)
        self._clearcoat()
        self._sheen()
        self._iridescence()

    def _put(self, out: dict[str, Any], names: str, parts: Mapping[str, Field], **how: Any) -> None:
        """A texture and the factors of one slot. names: of the texture, then of each part."""
        texture, *factors = names.split()
        info, found = self.textures.packed(self.look.name, parts, **how)
        for name, place in zip(factors, parts):
            value = found[place]
            out[name] = _numbers(value) if np.ndim(value) else float(value)
        if info:
            out[texture] = info

    def _specular(self) -> None:
        weight, color = self.look["specular"], self.look["specular_color"]
        if _is_one(weight) and _is_one(color):
            return
        out: dict[str, Any] = {}
        self._put(out, "specularTexture specularFactor", {"a": weight})
        self._put(
            out, "specularColorTexture specularColorFactor", {"rgb": color}, srgb=True, peak=True
        )
        self._extension("KHR_materials_specular", **out)

    def _is_solid(self) -> bool:
        return not (self.look["transmission"].is_zero or self.look.thin_walled)

    def _transmission(self, thickness: float) -> None:
        look = self.look
        if not look["transmission"].is_zero:
            out: dict[str, Any] = {}
            parts = {"r": look["transmission"]}
            self._put(out, "transmissionTexture transmissionFactor", parts)
            self._extension("KHR_materials_transmission", **out)
        if not look["diffuse_transmission"].is_zero:
            self._diffuse_transmission()
        passes = not (look["transmission"].is_zero and look["diffuse_transmission"].is_zero)
        if passes and not look.thin_walled:
            self._volume(thickness)
        if not look["dispersion"].is_zero:
            self._extension("KHR_materials_dispersion", dispersion=self._constant("dispersion"))

    def _diffuse_transmission(self) -> None:
        out: dict[str, Any] = {}
        name = "diffuseTransmission"
        weight, color = self.look["diffuse_transmission"], self.look["diffuse_transmission_color"]
        self._put(out, f"{name}Texture {name}Factor", {"a": weight})
        self._put(out, f"{name}ColorTexture {name}ColorFactor", {"rgb": color}, srgb=True)
        self._extension("KHR_materials_diffuse_transmission", **out)

    def _volume(self, thickness: float) -> None:
        inside: dict[str, Any] = {"thicknessFactor": max(thickness, 1e-6)}
        distance = self._constant("attenuation_distance")
        if distance > 0:
            color = self._constant("attenuation_color")
            inside.update(attenuationDistance=distance, attenuationColor=_numbers(color))
        self._extension("KHR_materials_volume", **inside)

    def _clearcoat(self) -> None:
        if self.look["clearcoat"].is_zero:
            return
        out: dict[str, Any] = {}
        self._put(out, "clearcoatTexture clearcoatFactor", {"r": self.look["clearcoat"]})
        parts = {"g": self.look["clearcoat_roughness"]}
        self._put(out, "clearcoatRoughnessTexture clearcoatRoughnessFactor", parts)
        if "clearcoat_normal_map" in self.look.maps:
            use = self.look.maps["clearcoat_normal_map"]
            out["clearcoatNormalTexture"] = self.textures.normal_map(self.look.name, use)
        self._extension("KHR_materials_clearcoat", **out)

    def _sheen(self) -> None:
        """The weight times the colour."""
        weight = self.look["sheen"]
        if weight.is_zero:
            return
        color = self.look["sheen_color"]
        folded = Field(np.multiply(color.value, self._constant("sheen")), color.use)
        out: dict[str, Any] = {}
        self._put(out, "sheenColorTexture sheenColorFactor", {"rgb": folded}, srgb=True)
        parts = {"a": self.look["sheen_roughness"]}
        self._put(out, "sheenRoughnessTexture sheenRoughnessFactor", parts)
        self._extension("KHR_materials_sheen", **out)

    def _iridescence(self) -> None:
        if self.look["iridescence"].is_zero:
            return
        out: dict[str, Any] = {"iridescenceIor": self._constant("iridescence_ior")}
        self._put(out, "iridescenceTexture iridescenceFactor", {"r": self.look["iridescence"]})
        thickness = self.look["iridescence_thickness"]
        low, high = 0.0, float(thickness.value)
        if thickness.use is not None:
            use = thickness.use
            low, high = use.offset * high, (use.scale + use.offset) * high
            plain = {"g": Field(1.0, replace(use, scale=1.0, offset=0.0))}
            self._put(out, "iridescenceThicknessTexture", plain)
        out.update(iridescenceThicknessMinimum=low, iridescenceThicknessMaximum=high)
        self._extension("KHR_materials_iridescence", **out)

    # ------------------------------------------------------------ what is left out

    def _constant(self, name: str) -> Any:
        """A parameter that glTF has no texture for: its mean is noted and taken."""
        field = self.look[name]
        if field.use is None:
            return field.value
        self.world.notes.add(self.look.name, f"the texture of {name} is left out: its mean taken")
        return self._mean(name)

    def _mean(self, name: str) -> Any:
        field = self.look[name]
        return field.value if field.use is None else self.textures.mean(field)

    def _note_rest(self) -> None:
        for name, neutral in _LEFT_OUT.items():
            if np.any(np.not_equal(self.look[name].value, neutral)):
                self.world.notes.add(self.look.name, f"{name} is left out")
        if "bump_map" in self.look.maps:
            self.world.notes.add(self.look.name, "bump_map is left out")
        if self.look.priority:
            self.world.notes.add(self.look.name, "priority is left out")


def _is_one(field: Field) -> bool:
    return field.use is None and bool(np.all(np.equal(field.value, 1)))


def _unit(value: Any) -> float:
    return min(max(float(value), 0.0), 1.0)


def _numbers(values: Any) -> list[float]:
    return [float(x) for x in np.ravel(values)]
