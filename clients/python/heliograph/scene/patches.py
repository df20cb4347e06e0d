"""Keyword arguments to the messages of an edit: entities, materials, meshes. Used by edit.py."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, checked, inline
from .._wire.lent import GpuArray, is_on_gpu
from ..errors import HeliographError, InvalidArgument
from ..values.checks import color_of, number_of, refuse_unknown, text_of, whole_of
from ..values.components import Camera, Tex, Visibility
from ..values.lights import Light, Portal
from ..values.pose import matrices_of, matrix_of
from ..values.ray_table import RayTable
from .handles import Named, Texture

if TYPE_CHECKING:
    from ..client.edit import Edits


class Components(TypedDict, total=False):
    """Components of an entity; absent: stays as it is; None: reset to its default."""

    transform: Any  #: 4x4 or Pose, relative to the parent
    keys: Mapping[float, Any] | None  #: {time in seconds: pose}, instead of transform
    parent: Named | None  #: whose frame the pose is in; None: the world
    mesh: Named | None  #: triangles; many entities may share one
    material: Named | None  #: for all parts
    materials: Sequence[Named] | None  #: one a part
    light: Light | None  #: given off by its mesh, or a shape, or a sun
    portal: Portal | None  #: where the dome shines in
    camera: Camera | None  #: looks along the entity's -Z, +Y up
    volume: Named | None  #: a medium that it shows
    skin: tuple[Sequence[Named], Any] | None  #: joints, (J, 4, 4) inverse binds
    morph_weights: Any  #: (T,), or {time: (T,)}
    # label ("auto", 0: none, or a number), category, group and part are one value: give them
    # together.
    label: int | str | None  #: "auto", a number, or 0: none; one value with the next three
    category: str  #: name of its class in the planes and labels
    group: bool  #: a crowd: one instance of many things
    part: int  #: number in the plane `part`
    visible: bool  #: False: no ray meets it, no label shows it
    visibility: Visibility | None  #: which rays meet it
    static: bool  #: it does not move, and is traced faster
    shadow_catcher: bool  #: only the plane shadow_catcher shows it
    teleport: bool  #: the pose is a jump: no flow over it
    attributes: Mapping[str, str] | None  #: {str: str}, which travels to the labels
    light_group: str | None  #: of all its light


class Parameters(TypedDict, total=False):
    """A material's parameters: a constant, a texture, or a Tex. None: reset to its default."""

    base_color: Any  #: [0, 1]: of the diffuse body, the metal, the glass
    metallic: Any  #: [0, 1]
    roughness: Any  #: [0, 1]
    specular: Any  #: [0, 1]
    specular_color: Any  #: >= 0
    ior: Any  #: [1, 4]
    transmission: Any  #: [0, 1]
    dispersion: Any  #: 20 over the Abbe number
    diffuse_transmission: Any  #: [0, 1]: of leaves and paper
    diffuse_transmission_color: Any
    emission: Any  #: >= 0: its colour
    emission_strength: Any  #: W sr^-1 m^-2
    alpha: Any  #: [0, 1]: opacity, by alpha_mode
    alpha_mode: str | None  #: "opaque", "mask", "blend"
    alpha_cutoff: float | None  #: [0, 1], of "mask"
    normal_map: Any  #: a texture or Tex; its strength in Tex.scale
    bump_map: Any  #: height; metres in Tex.scale
    clearcoat_normal_map: Any
    two_sided_emission: bool  #: the back emits too
    unlit: bool  #: shows base_color as it is
    subsurface: Any
    subsurface_radius: Any  #: metres
    subsurface_color: Any
    attenuation_color: Any
    attenuation_distance: Any  #: metres; 0: clear
    medium_density: Any  #: 1/m, by colour
    medium_albedo: Any
    medium_anisotropy: Any
    specular_tint: Any
    transmission_roughness: Any
    anisotropic: Any
    anisotropic_rotation: Any  #: turns
    sheen: Any
    sheen_color: Any
    sheen_roughness: Any
    sheen_tint: Any
    clearcoat: Any
    clearcoat_roughness: Any
    iridescence: Any
    iridescence_ior: Any
    iridescence_thickness: Any  #: nm; 0: no film
    thin_walled: bool  #: a sheet: light goes straight on
    priority: int | None  #: of a body where transmitting ones overlap; higher wins


_Component = TypeVar("_Component")
_LABEL = frozenset(("label", "category", "group", "part"))


def entity_message(edits: Edits, given: Mapping[str, Any]) -> pb.Entity:
    """The Entity of some Components."""
    refuse_unknown(given, Components, "an entity")
    out = pb.Entity()
    for one, other in (("transform", "keys"), ("material", "materials")):
        if one in given and other in given:
            raise InvalidArgument(f"give {one} or {other}, not both", field=other)
    for name, value in given.items():
        if name in _LABEL:
            continue
        if value is None:
            field = {"transform": "pose", "keys": "pose", "material": "materials"}.get(name, name)
            out.clear.append(field)
        else:
            _put_component(edits, out, name, value)
    if not _LABEL.isdisjoint(given):
        _put_label(out, given)
    return out


def labelled(given: Components) -> Components:
    """Makes an entity with a class an instance: its label is "auto" unless another is given."""
    if "label" in given or given.get("category") is None:
        return given
    return {**given, "label": "auto"}


def explained(error: HeliographError, transaction: pb.Transaction) -> HeliographError:
    """Adds which object edits[i] is about."""
    found = re.match(r"edits\[(\d+)\]", error.field)
    if found and int(found[1]) < len(transaction.edits):
        edit = transaction.edits[int(found[1])]
        name = edit.target.name
        error.args = (f"{error} [{edit.WhichOneof('action')} {name!r}]",) if name else error.args
    return error


def _put_component(edits: Edits, out: pb.Entity, name: str, value: Any) -> None:
    if name == "transform":
        out.pose.matrices.CopyFrom(inline(matrix_of(value, name)))
    elif name == "keys":
        _put_keys(edits, out.pose, value)
    elif name in ("parent", "mesh", "volume"):
        getattr(out, name).CopyFrom(edits.ref(value, name))
    elif name == "material":
        out.materials.parts.append(edits.ref(value, name))
    elif name == "materials":
        out.materials.SetInParent()
        out.materials.parts.extend(edits.ref(v, f"materials[{i}]") for i, v in enumerate(value))
    elif name == "light":
        out.light.CopyFrom(_of(Light, value, name).to_message())
        if value.texture is not None:
            out.light.texture.CopyFrom(texture_use(edits, value.texture, "light.texture"))
        if value.profile is not None:
            out.light.profile.CopyFrom(edits.ref(value.profile, "light.profile"))
    elif name == "portal":
        out.portal.CopyFrom(_of(Portal, value, name).to_message())
    elif name == "camera":
        out.camera.CopyFrom(_of(Camera, value, name).to_message())
        if value.rays is not None:
            _put_ray_table(edits, out.camera.rays, value.rays)
    elif name == "visibility":
        out.visibility.CopyFrom(_of(Visibility, value, name).to_message())
    elif name == "skin":
        out.skin.joints.extend(edits.ref(v, f"skin[{i}]") for i, v in enumerate(value[0]))
        binds = checked(value[1], "skin.inverse_binds", "<f4", (None, 4, 4))
        out.skin.inverse_binds.CopyFrom(inline(binds))
    elif name == "morph_weights":
        _put_morph_weights(out.morph_weights, value)
    elif name == "light_group":
        out.light_group = text_of(value, name)
    elif name == "attributes":
        out.attributes.SetInParent()
        out.attributes.values.update({str(k): str(v) for k, v in value.items()})
    else:
        setattr(out, name, bool(value))


def _of(kind: type[_Component], value: Any, field: str) -> _Component:
    if isinstance(value, kind):
        return value
    raise InvalidArgument(f"{field}: needs a hg.{kind.__name__}, not {value!r}", field=field)


def _put_ray_table(edits: Edits, out: pb.RayTable, table: RayTable) -> None:
    out.rays.CopyFrom(edits.asset(table.rays))
    if table.times is not None:
        out.times.CopyFrom(edits.asset(table.times))
    out.interpolated = table.interpolated


def _put_keys(edits: Edits, out: types.Pose, keys: Mapping[float, Any]) -> None:
    times = sorted(keys)
    out.times.CopyFrom(inline(checked(times, "keys", "<f8", (None,))))
    out.matrices.CopyFrom(edits.edited(matrices_of([keys[t] for t in times], "keys")))


def _put_morph_weights(out: pb.MorphWeights, value: Any) -> None:
    if isinstance(value, Mapping):
        times = sorted(value)
        out.times.CopyFrom(inline(checked(times, "morph_weights", "<f8", (None,))))
        rows = [value[t] for t in times]
        out.weights.CopyFrom(inline(checked(rows, "morph_weights", "<f4", (None, None))))
    else:
        out.weights.CopyFrom(inline(checked(value, "morph_weights", "<f4", (None,))))


def _put_label(out: pb.Entity, given: Mapping[str, Any]) -> None:
    label = given.get("label")
    if label is None and _LABEL.intersection(given) == {"label"}:
        out.clear.append("label")
        return
    if label == "auto":
        out.label.auto = True
    elif label is not None:
        if isinstance(label, (str, bool)):
            raise InvalidArgument(
                f'label: "auto", 0 (none) or a whole number below 2^32, not {label!r}',
                field="label",
            )
        out.label.value = whole_of(label, "label")
    if given.get("category") is not None:
        out.label.category = given["category"]
    if given.get("group") is not None:
        out.label.group = bool(given["group"])
    if given.get("part") is not None:
        out.label.part = whole_of(given["part"], "part")
    out.label.SetInParent()


def texture_use(edits: Edits, value: Any, field: str) -> pb.TextureUse:
    """The TextureUse of a texture handle, a name or a Tex."""
    use = value if isinstance(value, Tex) else Tex(value)
    out = pb.TextureUse(
        texture=edits.ref(use.texture, field),
        scale=number_of(use.scale, f"{field}.scale"),
        offset=number_of(use.offset, f"{field}.offset"),
        uv_set=whole_of(use.uv_set, f"{field}.uv_set"),
    )
    if use.channel:
        out.channel = whole_of(use.channel, f"{field}.channel")
    if use.uv is not None:
        out.uv_transform.CopyFrom(inline(checked(use.uv, f"{field}.uv", "<f4", (2, 3))))
    return out


def material_message(edits: Edits, given: Mapping[str, Any]) -> pb.Material:
    """The Material of some Parameters."""
    refuse_unknown(given, Parameters, "a material")
    out = pb.Material()
    for name, value in given.items():
        if value is None:
            out.clear.append(name)
        elif name == "alpha_mode":
            modes = ("opaque", "mask", "blend")
            if value not in modes:
                raise InvalidArgument(f"alpha_mode: one of {', '.join(modes)}", field=name)
            mode: Any = pb.Material.AlphaMode.Value(f"ALPHA_MODE_{value.upper()}")
            out.alpha_mode = mode
        elif name == "alpha_cutoff":
            out.alpha_cutoff = number_of(value, name)
        elif name in ("normal_map", "bump_map", "clearcoat_normal_map"):
            getattr(out, name).CopyFrom(texture_use(edits, value, name))
        elif name in ("two_sided_emission", "unlit", "thin_walled"):
            setattr(out, name, bool(value))
        elif name == "priority":
            out.priority = whole_of(value, name, -(2**31), 2**31 - 1)
        else:
            _put_parameter(edits, getattr(out, name), name, value)
    return out


def _put_parameter(edits: Edits, out: Any, name: str, value: Any) -> None:
    """A constant unbinds the texture; a texture sets the factor, which is 1 without a Tex."""
    factor = value
    if isinstance(value, (Tex, Texture, str)):
        factor = value.factor if isinstance(value, Tex) else 1.0
        out.texture.CopyFrom(texture_use(edits, value, name))
    else:
        out.texture.SetInParent()
    if isinstance(out, pb.ColorParameter):
        out.value.CopyFrom(color_of(factor, name))
    else:
        out.value = number_of(factor, name)


# Name, dtype and row length of the arrays of a mesh's topology.
_TOPOLOGY: dict[str, tuple[str, tuple[int | None, ...]]] = {
    "indices": ("<u4", (None, 3)),
    "uvs": ("<f4", (None, 2)),
    "uvs1": ("<f4", (None, 2)),
    "tangents": ("<f4", (None, 4)),
    "parts": ("<u4", (None,)),
    "joints": ("<u2", (None, 4)),
    "weights": ("<f4", (None, 4)),
    "morph_positions": ("<f4", (None, None, 3)),
    "morph_normals": ("<f4", (None, None, 3)),
    "skeleton": ("<u4", (None, 2)),
    "curves": ("<u4", (None,)),
    "radii": ("<f4", (None,)),
}


class Geometry(TypedDict, total=False):
    """A mesh's arrays; shapes as in proto/heliograph/v1/scene.proto."""

    positions: Any  #: (V, 3) metres, or (K, V, 3) with times
    times: Any  #: (K,) seconds
    indices: Any  #: (F, 3), counter-clockwise seen from outside; or:
    curves: Any  #: (S,) points of each strand: round curves through positions
    radii: Any  #: (V,) metres, with curves
    normals: Any  #: (V, 3), or (K, V, 3); None: flat
    uvs: Any  #: (V, 2)
    uvs1: Any  #: (V, 2): a second set, for Tex(uv_set=1)
    colors: Any  #: (V, 3) or (V, 4): float linear, or u8, u16 normalised
    tangents: Any  #: (V, 4)
    parts: Any  #: (F,) from 0, of each triangle or segment: the place in `materials`
    part_names: Sequence[str] | None  #: one a part
    joints: Any  #: (V, 4): places in the entity's skin=
    weights: Any  #: (V, 4): how much each joint counts
    morph_positions: Any  #: (T, V, 3) metres, added by morph_weights=
    morph_normals: Any  #: (T, V, 3), likewise
    keypoints: Mapping[str, Any] | None  #: {name: (3,)} in mesh coordinates
    skeleton: Any  #: (E, 2) edges between keypoints
    symmetries: Sequence[Any] | None  #: (4, 4) matrices, or {"axis": (3,), "offset": (3,)}


def mesh_message(edits: Edits, given: Mapping[str, Any]) -> pb.Mesh:
    """The Mesh of some Geometry; None is the same as absent: topology and vertices are replaced
    whole."""
    refuse_unknown(given, Geometry, "a mesh")
    out = pb.Mesh()
    keyed = given.get("times") is not None
    for name, value in given.items():
        if value is None:
            continue
        if name in ("positions", "normals"):
            shape: tuple[int | None, ...] = (None, None, 3) if keyed else (None, 3)
            array = (
                GpuArray(value, name, ("<f4",), shape)
                if is_on_gpu(value)
                else checked(value, name, "<f4", shape)
            )
            getattr(out, name).CopyFrom(edits.edited(array))
        elif name == "times":
            out.times.CopyFrom(inline(checked(value, name, "<f8", (None,))))
        elif name in _TOPOLOGY:
            dtype, shape = _TOPOLOGY[name]
            getattr(out, name).CopyFrom(edits.asset(checked(value, name, dtype, shape)))
        elif name == "colors":
            out.colors.CopyFrom(edits.asset(_colors(value)))
        elif name == "part_names":
            out.part_names.extend(value)
        elif name == "keypoints":
            for key, position in value.items():
                at = color_of(position, f"keypoints[{key!r}]")
                out.keypoints.append(pb.Keypoint(name=key, position=at))
        else:
            out.symmetries.extend(_symmetry(s, f"symmetries[{i}]") for i, s in enumerate(value))
    return out


def _colors(value: Any) -> NdArray:
    given = np.asarray(value)
    dtype = given.dtype.str if given.dtype in (np.uint8, np.uint16) else "<f4"
    width = given.shape[-1] if given.ndim == 2 and given.shape[-1] in (3, 4) else 3
    return checked(given, "colors", dtype, (None, width))


def _symmetry(value: Any, field: str) -> pb.Symmetry:
    if isinstance(value, Mapping):
        axis = color_of(value["axis"], f"{field}.axis")
        offset: types.Vec3 = color_of(value.get("offset", (0, 0, 0)), f"{field}.offset")
        return pb.Symmetry(axis=axis, offset=offset)
    return pb.Symmetry(matrix=inline(matrix_of(value, field)))
