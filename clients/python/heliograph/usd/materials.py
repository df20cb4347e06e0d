"""UsdShade materials to looks: UsdPreviewSurface here, OmniPBR in omnipbr.py. Needs pxr."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import omnipbr
from .context import Context
from .model import Look, Sampled
from .networks import Output, Textures, constant, fed

_PREVIEW = ("UsdPreviewSurface", "ND_UsdPreviewSurface_surfaceshader")
_CONTEXTS = ("", "mtlx", "mdl")
# Inputs of UsdPreviewSurface: default, and the parameter that it is.
_NUMBERS = {
    "roughness": (0.5, "roughness"),
    "clearcoat": (0.0, "clearcoat"),
    "clearcoatRoughness": (0.01, "clearcoat_roughness"),
    "ior": (1.5, "ior"),
}


class Looks:
    """Makes looks of a model, each once."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self._names: dict[str, str] = {}  # by the path that instances share

    def of(self, material: Any) -> str:
        """The name of a material's look: its path, that of the first instance seen."""
        prim = material.GetPrim()
        shared = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(shared.GetPath())
        if key not in self._names:
            self._names[key] = str(prim.GetPath())
            self.context.model.looks[self._names[key]] = self._made(material)
        return self._names[key]

    def _made(self, material: Any) -> Look:
        for context in _CONTEXTS:
            shader = material.ComputeSurfaceSource(context)[0]
            if shader:
                make = self._maker(shader)
                if make is not None:
                    return make(self.context, shader)
        kind = _kind(shader) if shader else "no surface shader"
        self.context.note(material, f"{kind} is left out: grey taken")
        return Look({"base_color": 0.18})

    def _maker(self, shader: Any) -> Callable[[Context, Any], Look] | None:
        kind = _kind(shader)
        return preview if kind in _PREVIEW else omnipbr.MAKERS.get(kind)


def _kind(shader: Any) -> str:
    """The id of a shader, or the name within the MDL module that it is from."""
    name = shader.GetSourceAssetSubIdentifier("mdl")
    return str(name or shader.GetShaderId() or "a shader without an id")


def preview(context: Context, shader: Any) -> Look:
    """A UsdPreviewSurface."""
    return _Preview(context, shader).look


class _Preview:
    def __init__(self, context: Context, shader: Any) -> None:
        self.context = context
        self.shader = shader
        self.look = Look()
        self.textures = Textures(context, self.look)
        self._color("diffuseColor", (0.18, 0.18, 0.18), "base_color")
        for name, (default, parameter) in _NUMBERS.items():
            self._number(name, default, parameter)
        self._specular()
        self._color("emissiveColor", (0.0, 0.0, 0.0), "emission")
        self.look.parameters["emission_strength"] = context.options.nit
        self._opacity()
        self._normal()
        self._note_rest()

    def _value(self, name: str, default: Any, is_color: bool) -> Any:
        """A constant or Sampled."""
        found = fed(self.context, self.shader, name)
        if not isinstance(found, Output):
            return constant(self.context, self.shader, name, default)
        if found.kind == "UsdUVTexture":
            if is_color and found.name != "rgb":
                self.context.note(
                    self.shader, f"{name} reads one channel: all of the texture taken"
                )
                found = Output(found.shader, "rgb")
            sampled = self.textures.sampled(found)
            return self._fallback(found, default) if sampled is None else sampled
        if found.kind.startswith("UsdPrimvarReader") and is_color:
            name_read = constant(self.context, found.shader, "varname", "")
            if name_read == "displayColor":
                self.look.colors = True
                return (1.0, 1.0, 1.0)
        self.context.note(self.shader, f"{name} is fed by {found.kind}: its default is taken")
        return default

    def _fallback(self, found: Output, default: Any) -> Any:
        """Value that stands for a texture that cannot be read."""
        value = constant(self.context, found.shader, "fallback", None)
        if value is None:
            return default
        return value[:3] if np.ndim(default) else value["rgba".find(found.name)]

    def _color(self, name: str, default: Any, parameter: str) -> None:
        found = self._value(name, default, True)
        if not isinstance(found, Sampled) and parameter == "base_color":
            found = tuple(np.clip(found, 0, 1))
        self.look.parameters[parameter] = found

    def _number(self, name: str, default: float, parameter: str) -> None:
        low, high = (1.0, 4.0) if name == "ior" else (0.0, 1.0)
        found = self._value(name, default, False)
        self.look.parameters[parameter] = (
            found if isinstance(found, Sampled) else min(max(found, low), high)
        )

    def _specular(self) -> None:
        """metallic, or specularColor as the reflectance at normal incidence."""
        if not constant(self.context, self.shader, "useSpecularWorkflow", 0.0):
            self._number("metallic", 0.0, "metallic")
            return
        found = self._value("specularColor", (0.0, 0.0, 0.0), True)
        ior = self.look.parameters["ior"]
        if isinstance(found, Sampled) or isinstance(ior, Sampled):
            self.context.note(self.shader, "specularColor by a texture is left out: 0.04 taken")
            return
        own = ((ior - 1) / (ior + 1)) ** 2
        self.look.parameters["specular_color"] = tuple(np.array(found) / max(own, 1e-4))

    def _opacity(self) -> None:
        found = self._value("opacity", 1.0, False)
        threshold = constant(self.context, self.shader, "opacityThreshold", 0.0)
        if found == 1.0:
            return
        self.look.parameters["alpha"] = found
        self.look.parameters["alpha_mode"] = "mask" if threshold > 0 else "blend"
        if threshold > 0:
            self.look.parameters["alpha_cutoff"] = min(threshold, 1.0)

    def _normal(self) -> None:
        found = fed(self.context, self.shader, "normal")
        if not isinstance(found, Output):
            return
        sampled = (
            self.textures.sampled(found, linear=True) if found.kind == "UsdUVTexture" else None
        )
        if sampled is None:
            self.context.note(self.shader, "its normal is no texture that can be read; left out")
            return
        put_normal(self.context, found.shader, self.look, sampled)

    def _note_rest(self) -> None:
        for name, text in (
            ("displacement", "displacement is left out"),
            ("occlusion", "occlusion is left out: light finds corners itself"),
        ):
            found = fed(self.context, self.shader, name)
            if isinstance(found, Output) or (name == "displacement" and found):
                self.context.note(self.shader, text)


def put_normal(context: Context, shader: Any, look: Look, sampled: Sampled) -> None:
    """Puts a normal map: normals are texel * 2 - 1; scale and bias count for their sign only."""
    scale = np.array(constant(context, shader, "scale", (2.0,) * 4))
    if scale[1] < 0 < scale[0]:
        context.note(shader, "a normal map whose green runs down is left out: turn it over")
        return
    look.parameters["normal_map"] = Sampled(
        sampled.texture, uv=sampled.uv, uv_set=sampled.uv_set, scale=1.0
    )
