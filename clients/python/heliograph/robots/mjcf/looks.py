"""Materials and textures. Used by edits.py; docs/mjcf.md maps each parameter.

Source: MuJoCo's manual, "XML Reference", asset/material and asset/texture.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..._wire.arrays import NdArray
from ...image.tonemap import decode_srgb
from ...scene.handles import Material, Texture
from ...values.components import Tex
from .reading import Compiled, mujoco

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ...scene.patches import Parameters

_UNSET = (0.5, 0.5, 0.5, 1.0)  # default rgba; a material's own goes before it
_SPECULAR = _SHININESS = 0.5  # of a geom without a material
_ROLES = ("RGB", "RGBA", "ROUGHNESS", "METALLIC", "NORMAL", "ORM")


@dataclass(frozen=True)
class Look:
    """Look of a geom. material: its number, -1 for none. rgba: sRGB. mirror: True if its kind shows
    reflectance."""

    material: int
    rgba: tuple[float, ...]
    mirror: bool = False


def look_of(model: Any, material: int, rgba: Any, mirror: bool = False) -> Look:
    own = tuple(float(x) for x in rgba)
    if material >= 0 and np.allclose(own, _UNSET):
        own = tuple(float(x) for x in model.mat_rgba[material])
    return Look(int(material), own, mirror and material >= 0)


def linear(rgb: Any) -> NdArray:
    """(3,) of a colour as MuJoCo shows it."""
    return np.asarray(decode_srgb(np.clip(np.array(rgb, "f8"), 0, 1)))


def texture_of(model: Any, look: Look, role: str = "RGB") -> int:
    """The number of a texture; -1: none."""
    if look.material < 0:
        return -1
    found = np.atleast_1d(model.mat_texid[look.material])
    if not hasattr(mujoco(), "mjtTextureRole"):
        return int(found[0]) if role == "RGB" else -1
    number = int(getattr(mujoco().mjtTextureRole, f"mjTEXROLE_{role}"))
    if role == "RGB" and found[number] < 0:
        number = int(mujoco().mjtTextureRole.mjTEXROLE_RGBA)
    return int(found[number])


def is_flat(model: Any, texture: int) -> bool:
    """True for one picture, False for a cube of six."""
    return bool(model.tex_type[texture] == mujoco().mjtTexture.mjTEXTURE_2D)


def texels_of(model: Any, texture: int) -> NdArray:
    """(H, W, C) uint8; of a cube its faces one below the other."""
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels = int(model.tex_nchannel[texture]) if hasattr(model, "tex_nchannel") else 3
    values = model.tex_data if hasattr(model, "tex_data") else model.tex_rgb
    start = int(model.tex_adr[texture])
    flat = np.array(values[start : start + height * width * channels], "u1")
    return flat.reshape(height, width, channels)


@dataclass
class Looks:
    """The materials of one file, made as they are met."""

    source: Compiled
    prefix: str  # of names
    warnings: list[str]
    materials: dict[Look, Material] = field(default_factory=dict)
    textures: dict[int, Texture] = field(default_factory=dict)
    names: set[str] = field(default_factory=set)

    def material(self, edits: Edits, look: Look) -> Material:
        if look not in self.materials:
            name = self._name(look)
            given = self._parameters(edits, look)
            self.materials[look] = edits.material(name, exist_ok=False, **given)
        return self.materials[look]

    def _name(self, look: Look) -> str:
        names = self.source.names("material", self.source.model.nmat)
        stem = names[look.material] if look.material >= 0 else "plain"
        name = f"{self.prefix}/material/{stem}"
        if name in self.names:
            name = f"{name}_{len(self.names)}"
        self.names.add(name)
        return name

    def _parameters(self, edits: Edits, look: Look) -> Parameters:
        *rgb, alpha = look.rgba
        out: dict[str, Any] = {"base_color": linear(rgb), "alpha": alpha}
        self._put_gloss(out, look)
        self._put_textures(edits, out, look)
        if out["alpha"] != 1:
            out["alpha_mode"] = "blend"
        return cast("Parameters", out)

    def _put_gloss(self, out: dict[str, Any], look: Look) -> None:
        model, m = self.source.model, look.material
        specular, shininess = _SPECULAR, _SHININESS
        if m >= 0:
            specular, shininess = float(model.mat_specular[m]), float(model.mat_shininess[m])
        # Walter et al. 2007, section 5.1: Blinn's exponent 128 * shininess as a width of slopes.
        out.update(specular=min(specular, 1.0), roughness=(2 / (128 * shininess + 2)) ** 0.25)
        if m < 0:
            return
        reflectance = float(model.mat_reflectance[m])
        if look.mirror and reflectance > 0:
            out.update(metallic=min(reflectance, 1.0), roughness=0.0)
        for name in ("metallic", "roughness"):
            known = getattr(model, f"mat_{name}", None)
            if known is not None and known[m] >= 0:
                out[name] = min(float(known[m]), 1.0)
        emission = float(model.mat_emission[m])
        if emission > 0:
            out["emission"] = linear(np.array(look.rgba[:3]) * emission)

    # ------------------------------------------------------------ textures

    def _put_textures(self, edits: Edits, out: dict[str, Any], look: Look) -> None:
        model = self.source.model
        color = texture_of(model, look)
        if color >= 0:
            texture = self._texture(edits, color)
            out["base_color"] = Tex(texture, factor=out["base_color"])
            if "emission" in out:
                out["emission"] = Tex(texture, factor=out["emission"])
            texels = texels_of(model, color)
            if texels.shape[2] == 4 and texels[..., 3].min() < 255:
                out["alpha"] = Tex(texture, factor=out["alpha"], channel=3)
        self._put_further(edits, out, look)

    def _put_further(self, edits: Edits, out: dict[str, Any], look: Look) -> None:
        """Adds the textures of MuJoCo's layers: roughness, metallic and the like."""
        if not hasattr(mujoco(), "mjtTextureRole"):
            return
        model = self.source.model
        uses = (
            ("ROUGHNESS", "roughness", 0),
            ("METALLIC", "metallic", 0),
            ("ORM", "roughness", 1),
            ("ORM", "metallic", 2),
        )
        for role, parameter, channel in uses:
            found = texture_of(model, look, role)
            if found >= 0:
                texture = self._texture(edits, found, "linear")
                out[parameter] = Tex(texture, factor=1.0, channel=channel)
        normal = texture_of(model, look, "NORMAL")
        if normal >= 0:
            out["normal_map"] = self._texture(edits, normal, "linear")
        self._warn_of_roles(look)

    def _warn_of_roles(self, look: Look) -> None:
        if look.material < 0:
            return
        model, roles = self.source.model, mujoco().mjtTextureRole
        names = self.source.names("texture", model.ntex)
        for role in ("OCCLUSION", "OPACITY", "EMISSIVE"):
            found = int(model.mat_texid[look.material][int(getattr(roles, f"mjTEXROLE_{role}"))])
            if found >= 0:
                self._warn(f"texture {names[found]!r}: its role {role.lower()} is left out")

    def _warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def _texture(self, edits: Edits, number: int, encoding: str = "srgb") -> Texture:
        if number not in self.textures:
            model = self.source.model
            name = self.source.names("texture", model.ntex)[number]
            self.textures[number] = edits.texture(
                f"{self.prefix}/texture/{name}",
                texels_of(model, number),
                encoding=encoding,
                wrap="repeat" if is_flat(model, number) else "clamp",
                exist_ok=False,
            )
        return self.textures[number]
