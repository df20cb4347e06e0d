"""Meshes of the scene to UsdGeomMesh. Needs pxr."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdShade, Vt

from ..._wire.arrays import NdArray
from ..emission import Emission
from ..geometry import Geometry
from ..motion import mixed_at
from ..world import World
from .materials import NIT, Materials
from .stage import Stage

_NORMALS = Sdf.ValueTypeNames.Normal3fArray
_COORDINATES = Sdf.ValueTypeNames.TexCoord2fArray


class Morphs:
    """Weights of an entity's targets over time: (K,) seconds, (K, T)."""

    def __init__(self, times: NdArray, weights: NdArray) -> None:
        self.times = times
        self.weights = weights

    def at(self, time: float) -> NdArray:
        return mixed_at(self.times, self.weights, time)


class Meshes:
    """Defines meshes in a stage."""

    def __init__(self, world: World, stage: Stage, materials: Materials) -> None:
        self.world = world
        self.stage = stage
        self.materials = materials

    def define(
        self,
        path: str,
        geometry: Geometry,
        bound: list[int | None],
        emission: Emission | None,
        morphs: Morphs,
    ) -> Any:
        """A mesh with its materials, one per part, the last one for the rest."""
        mesh = UsdGeom.Mesh.Define(self.stage.stage, path)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        faces = geometry.indices
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, "i4")))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel().astype("i4")))
        self._put_shape(mesh, geometry, morphs)
        self._put_coordinates(mesh, geometry)
        self._bind(mesh, geometry, bound)
        if emission is not None:
            self._put_emission(mesh, geometry, emission)
        if geometry.tangents is not None:
            self.world.notes.add(geometry.name, "tangents are left out")
        return mesh

    def _put_shape(self, mesh: Any, geometry: Geometry, morphs: Morphs) -> None:
        """Points, normals and boxes; targets are worked in, as USD mixes points linearly, too."""
        moving = [times for times in (geometry.times, morphs.times) if len(times) > 1]
        times = np.unique(np.concatenate(moving)) if moving else [self.world.time]
        primvar = None
        if geometry.keyed_normals is not None:
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
                "normals", _NORMALS, UsdGeom.Tokens.vertex
            )
        for time in times:
            at = (self.stage.code(time),) if moving else ()
            points = geometry.positions_at(time, morphs.at(time))
            mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), *at)
            box = np.stack([points.min(axis=0), points.max(axis=0)])
            mesh.CreateExtentAttr().Set(Vt.Vec3fArray.FromNumpy(box), *at)
            normals = geometry.normals_at(time, morphs.at(time))
            if primvar is not None and normals is not None:
                primvar.Set(Vt.Vec3fArray.FromNumpy(normals), *at)

    def _put_coordinates(self, mesh: Any, geometry: Geometry) -> None:
        for name, uvs in zip(("st", "st1"), geometry.uvs):
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
                name, _COORDINATES, UsdGeom.Tokens.vertex
            )
            primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(uvs)))

    # ------------------------------------------------------------ materials

    def _bind(self, mesh: Any, geometry: Geometry, bound: list[int | None]) -> None:
        colored = self._put_colors(mesh, geometry, bound)
        parts = np.unique(geometry.parts).tolist()
        api = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
        first = bound[min(parts[0], len(bound) - 1)]
        api.Bind(self.materials.of(first, colored))
        for part in parts[1:]:
            name = self.stage.path(str(mesh.GetPath()), geometry.part_name(part) or f"part_{part}")
            subset = UsdGeom.Subset.Define(self.stage.stage, name)
            subset.CreateElementTypeAttr(UsdGeom.Tokens.face)
            subset.CreateFamilyNameAttr("materialBind")
            faces = np.flatnonzero(geometry.parts == part).astype("i4")
            subset.CreateIndicesAttr(Vt.IntArray.FromNumpy(faces))
            own = self.materials.of(bound[min(part, len(bound) - 1)], colored)
            UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(own)
        if len(parts) > 1:
            UsdGeom.Subset.SetFamilyType(mesh, "materialBind", UsdGeom.Tokens.nonOverlapping)

    def _put_colors(self, mesh: Any, geometry: Geometry, bound: list[int | None]) -> bool:
        """displayColor of a mesh with colours, times the colours of its materials; False: it has
        none, or a texture that they cannot multiply."""
        if geometry.colors is None:
            return False
        bases = [self.materials.look(key)["base_color"] for key in bound]
        if any(base.use for base in bases):
            self.world.notes.add(geometry.name, "colours of vertices are left out beside textures")
            return False
        factors = np.array([base.value for base in bases])
        which = np.minimum(geometry.parts, len(bound) - 1)
        corners = geometry.colors[:, :3][geometry.indices] * factors[which][:, None]
        primvar = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.faceVarying)
        colors = np.ascontiguousarray(corners.reshape(-1, 3), dtype="f4")
        if len(np.unique(factors, axis=0)) == 1:
            primvar = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
            colors = np.ascontiguousarray(geometry.colors[:, :3] * factors[0], dtype="f4")
        primvar.Set(Vt.Vec3fArray.FromNumpy(colors))
        if (geometry.colors[:, 3] != 1).any():
            self.world.notes.add(geometry.name, "the opacity of colours of vertices is left out")
        return True

    def _put_emission(self, mesh: Any, geometry: Geometry, emission: Emission) -> None:
        api = UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
        light = UsdLux.LightAPI(mesh.GetPrim())
        put_strength(light, np.array(emission.radiance) * NIT)
        api.GetPrim().GetAttribute("light:materialSyncMode").Set("independent")
        if emission.use is not None:
            self.world.notes.add(geometry.name, "the texture of a light is left out")
        if emission.two_sided:
            self.world.notes.add(geometry.name, "its light comes from its front alone")


def put_strength(light: Any, strength: NdArray) -> None:
    """color and intensity of a UsdLux light, (3,)."""
    most = float(strength.max())
    light.CreateIntensityAttr(most)
    light.CreateColorAttr(Gf.Vec3f(*(strength / most if most > 0 else strength).tolist()))
