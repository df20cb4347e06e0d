"""Looks to UsdPreviewSurface. Needs pxr. Source: UsdPreviewSurface Specification 2.6."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdShade

from ..._wire._proto import scene_pb2 as pb
from ..inside import without_inside
from ..lamps import LUMENS_PER_WATT
from ..looks import Field, Look, Picture, Use, look_of, picture_of, quantized
from ..world import World
from .stage import TOP, Stage

NIT = LUMENS_PER_WATT  #: USD's number for 1 W sr^-1 m^-2: USD counts in cd/m^2
_TYPES = Sdf.ValueTypeNames
_SHEAR = 1e-5
_SIGNED, _BELOW = (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0)  # of normal maps
Affine = tuple[tuple[float, ...], tuple[float, ...]]  # scale and bias
_FAINT = 0.1  # opacity of glass, so that programs that show no reflection of it show it
# Parameters that UsdPreviewSurface has none for, besides the subsurface.
_LEFT_OUT = (
    *("sheen", "anisotropic", "iridescence", "medium_density", "transmission_roughness"),
    *("diffuse_transmission", "dispersion"),
    *("specular_tint", "attenuation_distance", "subsurface"),
)


class Materials:
    """Puts materials and their textures into a stage, each once."""

    def __init__(self, world: World, stage: Stage) -> None:
        self.world = world
        self.stage = stage
        self._made: dict[tuple[int | None, bool], Any] = {}
        self._pictures: dict[int, Picture] = {}
        self._files: dict[int, Any] = {}
        self._normals: dict[tuple[int, float], Any] = {}
        self._looks: dict[int | None, Look] = {}

    def look(self, key: int | None) -> Look:
        if key not in self._looks:
            shared = self.world.shared[key] if key is not None else None
            name = "default" if shared is None else shared.name or f"material {key}"
            message = pb.Material() if shared is None else shared.message
            self._looks[key] = without_inside(self.world, look_of(self.world, name, message))
        return self._looks[key]

    def of(self, key: int | None, colored: bool) -> Any:
        """A UsdShade.Material. colored: its diffuse colour is the mesh's displayColor."""
        if (key, colored) not in self._made:
            look = self.look(key)
            path = self.stage.path(f"{TOP}/Materials", look.name)
            self._made[key, colored] = _Writer(self, look, path, colored).material
        return self._made[key, colored]

    def picture(self, key: int) -> Picture:
        if key not in self._pictures:
            self._pictures[key] = picture_of(self.world, key)
        return self._pictures[key]

    def file(self, key: int) -> Any:
        """The asset path of a texture."""
        if key not in self._files:
            self._files[key] = self.stage.picture(self.picture(key))
        return self._files[key]

    def normals(self, key: int, strength: float) -> Any:
        """The asset path of a normal map whose slopes are so many times as steep: USD has no
        strength beside it."""
        picture = self.picture(key)
        if strength == 1 and not picture.srgb:
            return self.file(key)
        if (key, strength) not in self._normals:
            steep = (picture.rgba()[..., :3] * 2 - 1) * (strength, strength, 1)
            unit = steep / np.maximum(np.linalg.norm(steep, axis=-1, keepdims=True), 1e-6)
            texels = quantized(0.5 + 0.5 * unit, picture.texels.dtype != np.uint8)
            made = replace(picture, texels=texels, srgb=False)
            self._normals[key, strength] = self.stage.picture(made)
        return self._normals[key, strength]


class _Writer:
    """Writer of one material."""

    def __init__(self, materials: Materials, look: Look, path: str, colored: bool) -> None:
        self.materials = materials
        self.world = materials.world
        self.stage = materials.stage.stage
        self.look = look
        self.path = path
        self.material = UsdShade.Material.Define(self.stage, path)
        self.material.GetPrim().SetDisplayName(look.name)
        self.surface = self._shader("Surface", "UsdPreviewSurface")
        output = self.surface.CreateOutput("surface", _TYPES.Token)
        self.material.CreateSurfaceOutput().ConnectToSource(output)
        self._textures: dict[Any, Any] = {}
        self._diffuse(colored)
        self._shine()
        self._emission()
        self._opacity()
        self._normal()
        self._note_rest()

    def _shader(self, name: str, kind: str) -> Any:
        path = self.materials.stage.path(self.path, name)
        shader = UsdShade.Shader.Define(self.stage, path)
        shader.CreateIdAttr(kind)
        return shader

    def _note(self, text: str) -> None:
        self.world.notes.add(self.look.name, text)

    # ------------------------------------------------------------ inputs

    def _diffuse(self, colored: bool) -> None:
        base = self.look["base_color"]
        if self.look.unlit:
            self._color("diffuseColor", Field((0.0, 0.0, 0.0)))
        elif colored:
            reader = self._shader("DisplayColor", "UsdPrimvarReader_float3")
            reader.CreateInput("varname", _TYPES.String).Set("displayColor")
            output = reader.CreateOutput("result", _TYPES.Float3)
            self.surface.CreateInput("diffuseColor", _TYPES.Color3f).ConnectToSource(output)
        else:
            self._color("diffuseColor", base)

    def _shine(self) -> None:
        self._number("roughness", self.look["roughness"])
        self._number("ior", self.look["ior"])
        self._number("clearcoat", self.look["clearcoat"])
        self._number("clearcoatRoughness", self.look["clearcoat_roughness"])
        metallic, weight, tint = (
            self.look[name] for name in ("metallic", "specular", "specular_color")
        )
        is_plain = all(f.use is None and np.all(np.equal(f.value, 1)) for f in (weight, tint))
        used = weight.use or tint.use or self.look["ior"].use
        if is_plain or used or not metallic.is_zero:
            self._number("metallic", metallic)
            if not is_plain:
                self._note("specular and specular_color are left out beside metallic or textures")
            return
        ior = self.look.number("ior")
        ahead = ((ior - 1) / (ior + 1)) ** 2
        self.surface.CreateInput("useSpecularWorkflow", _TYPES.Int).Set(1)
        reflected = np.clip(np.multiply(tint.value, weight.value) * ahead, 0, 1)
        self._color("specularColor", Field(tuple(reflected.tolist())))

    def _emission(self) -> None:
        if self.look.unlit:
            self._note("unlit is written as emission")
            self._color("emissiveColor", self.look["base_color"], NIT)
        elif self.look.emits:
            strength = self._mean("emission_strength")
            self._color("emissiveColor", self.look["emission"], strength * NIT)
            if self.look.two_sided_emission:
                self._note("the back gives off light in some programs only")

    def _opacity(self) -> None:
        """Alpha, less the transmission."""
        alpha, passing = self.look["alpha"], self.look["transmission"]
        share = 1.0
        if not passing.is_zero:
            share -= self._mean("transmission") * (1 - self._mean("metallic"))
            share = max(share, _FAINT)
            self._note("transmission is written as opacity: light goes straight on")
        if self.look.alpha_mode == "opaque":
            alpha = Field(1.0)
        if alpha.use is None and alpha.value * share == 1:
            return
        self._number("opacity", Field(alpha.value * share, alpha.use))
        if self.look.alpha_mode == "mask":
            self.surface.CreateInput("opacityThreshold", _TYPES.Float).Set(self.look.alpha_cutoff)

    def _normal(self) -> None:
        use = self.look.maps.get("normal_map")
        if use is None:
            return
        file = self.materials.normals(use.texture, use.scale)
        output = self._texture(use, (_SIGNED, _BELOW), "rgb", "raw", file)
        self.surface.CreateInput("normal", _TYPES.Normal3f).ConnectToSource(output)

    def _mean(self, name: str) -> float:
        """A number that a texture may not drive here."""
        field = self.look[name]
        if field.use is None:
            return float(field.value)
        self._note(f"the texture of {name} is left out: its mean taken")
        values = self.materials.picture(field.use.texture).values(field.use, False)
        return float(values.mean(dtype="f8") * field.value)

    def _note_rest(self) -> None:
        for name in _LEFT_OUT:
            if not self.look[name].is_zero:
                self._note(f"{name} is left out")
        for name in ("bump_map", "clearcoat_normal_map"):
            if name in self.look.maps:
                self._note(f"{name} is left out")
        if self.look.priority:
            self._note("priority is left out")

    # ------------------------------------------------------------ values

    def _color(self, name: str, field: Field, factor: float = 1.0) -> None:
        port = self.surface.CreateInput(name, _TYPES.Color3f)
        value = np.multiply(field.value, factor) * np.ones(3)
        if field.use is None:
            port.Set(Gf.Vec3f(*value.tolist()))
            return
        scale = (*(value * field.use.scale).tolist(), 1.0)
        bias = (*(value * field.use.offset).tolist(), 0.0)
        space = "sRGB" if self.materials.picture(field.use.texture).srgb else "raw"
        port.ConnectToSource(self._texture(field.use, (scale, bias), "rgb", space))

    def _number(self, name: str, field: Field) -> None:
        port = self.surface.CreateInput(name, _TYPES.Float)
        if field.use is None:
            port.Set(float(field.value))
            return
        use, value = field.use, float(field.value)
        picture = self.materials.picture(use.texture)
        if use.channel == 3 and not picture.has_alpha():
            port.Set(value * (use.scale + use.offset))
            return
        affine = (value * use.scale,) * 4, (value * use.offset,) * 4
        space = "sRGB" if picture.srgb and use.channel < 3 else "raw"
        port.ConnectToSource(self._texture(use, affine, "rgba"[use.channel], space))

    def _texture(self, use: Use, affine: Affine, output: str, space: str, file: Any = None) -> Any:
        """The output of a UsdUVTexture: texel scale + bias."""
        file = file or self.materials.file(use.texture)
        key = (file.path, use.uv, use.uv_set, affine, space)
        if key not in self._textures:
            self._textures[key] = self._made(use, affine, space, file)
        kind = _TYPES.Float3 if output == "rgb" else _TYPES.Float
        return self._textures[key].CreateOutput(output, kind)

    def _made(self, use: Use, affine: Affine, space: str, file: Any) -> Any:
        picture = self.materials.picture(use.texture)
        if picture.nearest:
            self._note("textures that are not filtered are enlarged: USD filters all")
        shader = self._shader("Texture", "UsdUVTexture")
        shader.CreateInput("file", _TYPES.Asset).Set(file)
        shader.CreateInput("sourceColorSpace", _TYPES.Token).Set(space)
        for axis, wrap in zip("ST", picture.wrap):
            shader.CreateInput(f"wrap{axis}", _TYPES.Token).Set(wrap)
        plain: Mapping[str, tuple[float, ...]] = {"scale": (1.0,) * 4, "bias": (0.0,) * 4}
        for name, values in zip(("scale", "bias"), affine):
            if values != plain[name]:
                shader.CreateInput(name, _TYPES.Float4).Set(Gf.Vec4f(*values))
        shader.CreateInput("st", _TYPES.Float2).ConnectToSource(self._coordinates(use))
        return shader

    def _coordinates(self, use: Use) -> Any:
        reader = self._shader("Coordinates", "UsdPrimvarReader_float2")
        reader.CreateInput("varname", _TYPES.String).Set(("st", "st1")[use.uv_set])
        output = reader.CreateOutput("result", _TYPES.Float2)
        if not use.is_turned:
            return output
        (a, b, x), (c, d, y) = use.uv
        angle = math.atan2(c, a)
        scale = math.hypot(a, c), d * math.cos(angle) - b * math.sin(angle)
        if abs(b * math.cos(angle) + d * math.sin(angle)) > _SHEAR * max(map(abs, (a, b, c, d))):
            self._note("the shear of texture coordinates is left out")
        turned = self._shader("Transform", "UsdTransform2d")
        turned.CreateInput("in", _TYPES.Float2).ConnectToSource(output)
        turned.CreateInput("rotation", _TYPES.Float).Set(math.degrees(angle))
        turned.CreateInput("scale", _TYPES.Float2).Set(Gf.Vec2f(*scale))
        turned.CreateInput("translation", _TYPES.Float2).Set(Gf.Vec2f(x, y))
        return turned.CreateOutput("result", _TYPES.Float2)
