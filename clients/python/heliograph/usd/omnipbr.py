"""OmniPBR and OmniGlass, materials of MDL, by the names of their parameters. Needs pxr."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Sdf

from .context import Context
from .model import Image, Look, Sampled
from .networks import ENCODINGS, Output, Textures, constant, fed

_LEFT_OUT = (
    *("albedo_add", "albedo_desaturation", "detail_bump_factor", "detail_normalmap_texture"),
    *("ao_texture", "emissive_mask_texture", "project_uvw", "opacity_texture_rotate"),
)


class _Mdl:
    """Inputs of one MDL material: constants, and textures that are asset paths."""

    def __init__(self, context: Context, shader: Any) -> None:
        self.context = context
        self.shader = shader
        self.look = Look()
        self.textures = Textures(context, self.look)

    def number(self, name: str, default: float) -> float:
        return float(constant(self.context, self.shader, name, default))

    def color(self, name: str, default: tuple[float, float, float]) -> Any:
        return np.array(constant(self.context, self.shader, name, default), dtype="f8")[:3]

    def texture(self, name: str, linear: bool) -> Image | None:
        found = fed(self.context, self.shader, name)
        if not isinstance(found, Sdf.AssetPath) or not found.path:
            return None
        attribute = self.shader.GetInput(name).GetAttr()
        space = attribute.GetColorSpace() if attribute.HasColorSpace() else ""
        own = "linear" if linear else None
        encoding = ENCODINGS.get(space, own)
        return self.textures.image(self.shader, found, encoding, ("repeat", "repeat"))

    def sampled(self, image: Image, **given: Any) -> Sampled:
        return Sampled(
            image, uv=self._uv(), uv_set=self.textures.uv_set(self.shader, "st"), **given
        )

    def _uv(self) -> Any:
        """(2, 3) of texture_scale, texture_rotate and texture_translate; None: the identity."""
        scale = constant(self.context, self.shader, "texture_scale", (1.0, 1.0))
        move = constant(self.context, self.shader, "texture_translate", (0.0, 0.0))
        angle = np.radians(self.number("texture_rotate", 0.0))
        if (*scale, *move, angle) == (1, 1, 0, 0, 0):
            return None
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]]) @ np.diag(scale)
        return tuple((*map(float, row), float(m)) for row, m in zip(turn, move))

    def note_rest(self) -> None:
        for name in _LEFT_OUT:
            found = fed(self.context, self.shader, name)
            is_set = isinstance(found, Output) or (isinstance(found, Sdf.AssetPath) and found.path)
            if is_set or (isinstance(found, (bool, int, float)) and found):
                self.context.note(self.shader, f"{name} is left out")


def omnipbr(context: Context, shader: Any) -> Look:
    """OmniPBR: textures take the place of constants, or mix with them by their influence."""
    mdl = _Mdl(context, shader)
    _put_base(mdl)
    _put_reflection(mdl)
    _put_emission(mdl)
    _put_opacity(mdl)
    image = mdl.texture("normalmap_texture", linear=True)
    if image is not None:
        mdl.look.parameters["normal_map"] = mdl.sampled(image, scale=mdl.number("bump_factor", 1.0))
    mdl.note_rest()
    return mdl.look


def _put_base(mdl: _Mdl) -> None:
    tint = mdl.color("diffuse_tint", (1.0, 1.0, 1.0)) * mdl.number("albedo_brightness", 1.0)
    image = mdl.texture("diffuse_texture", linear=False)
    if image is None:
        color = mdl.color("diffuse_color_constant", (0.2, 0.2, 0.2)) * tint
        mdl.look.parameters["base_color"] = tuple(np.clip(color, 0, 1))
        return
    most = max(float(tint.max()), 1.0)
    mdl.look.parameters["base_color"] = mdl.sampled(image, factor=tuple(tint / most), scale=most)


def _put_reflection(mdl: _Mdl) -> None:
    """roughness and metallic: constant + influence (texel - constant)."""
    orm = None
    if constant(mdl.context, mdl.shader, "enable_ORM_texture", False):
        orm = mdl.texture("ORM_texture", linear=True)
    for parameter, base, channel, default in (
        ("roughness", "reflection_roughness", 1, 0.5),
        ("metallic", "metallic", 2, 0.0),
    ):
        value = mdl.number(f"{base}_constant", default)
        name = "reflectionroughness" if parameter == "roughness" else parameter
        image = orm or mdl.texture(f"{name}_texture", linear=True)
        share = 1.0 if orm else mdl.number(f"{base}_texture_influence", 0.0)
        if image is None or share == 0:
            mdl.look.parameters[parameter] = min(max(value, 0.0), 1.0)
            continue
        affine = {"scale": share, "offset": (1 - share) * value, "fallback": value}
        mdl.look.parameters[parameter] = mdl.sampled(image, channel=channel if orm else 0, **affine)
    mdl.look.parameters["specular"] = min(2 * mdl.number("specular_level", 0.5), 1.0)


def _put_emission(mdl: _Mdl) -> None:
    if not constant(mdl.context, mdl.shader, "enable_emission", False):
        return
    color = mdl.color("emissive_color", (1.0, 0.1, 0.1))
    image = mdl.texture("emissive_color_texture", linear=False)
    intensity = mdl.number("emissive_intensity", 40.0)
    mdl.look.parameters["emission"] = tuple(color) if image is None else mdl.sampled(image)
    mdl.look.parameters["emission_strength"] = intensity * mdl.context.options.nit


def _put_opacity(mdl: _Mdl) -> None:
    if not constant(mdl.context, mdl.shader, "enable_opacity", False):
        return
    image = None
    if constant(mdl.context, mdl.shader, "enable_opacity_texture", False):
        image = mdl.texture("opacity_texture", linear=True)
    value = mdl.number("opacity_constant", 1.0)
    threshold = mdl.number("opacity_threshold", 0.0)
    mdl.look.parameters["alpha"] = value if image is None else mdl.sampled(image, fallback=value)
    mdl.look.parameters["alpha_mode"] = "mask" if threshold > 0 else "blend"
    if threshold > 0:
        mdl.look.parameters["alpha_cutoff"] = min(threshold, 1.0)


def omniglass(context: Context, shader: Any) -> Look:
    """OmniGlass without its textures."""
    mdl = _Mdl(context, shader)
    mdl.look.parameters.update(
        base_color=tuple(np.clip(mdl.color("glass_color", (1.0, 1.0, 1.0)), 0, 1)),
        transmission=1.0,
        ior=min(max(mdl.number("glass_ior", 1.491), 1.0), 4.0),
        roughness=min(max(mdl.number("frosting_roughness", 0.0), 0.0), 1.0),
        thin_walled=bool(constant(context, shader, "thin_walled", False)),
    )
    for name in ("glass_color_texture", "roughness_texture", "normal_map_texture"):
        if mdl.texture(name, linear=True) is not None:
            context.note(shader, f"{name} is left out")
    return mdl.look


MAKERS: dict[str, Callable[[Context, Any], Look]] = {"OmniPBR": omnipbr, "OmniGlass": omniglass}
