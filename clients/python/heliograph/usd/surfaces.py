"""Gprims to meshes with the materials of their parts. Needs pxr."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import UsdGeom, UsdShade

from .._wire.arrays import NdArray
from . import curves, gprims, materials, meshes
from .context import Context
from .model import Look, Node

if TYPE_CHECKING:
    from ..scene.patches import Geometry

_GREY = (0.18, 0.18, 0.18)  # of what has neither material nor displayColor, as in usdview


@dataclass(frozen=True)
class Part:
    """Faces with one material; faces None: those that no subset has."""

    name: str
    faces: NdArray | None
    look: str


class Surfaces:
    """Makes meshes and looks of a model, each once."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.looks = materials.Looks(context)
        self.vertices: dict[str, NdArray] = {}  # the points that those of a mesh are
        self._meshes: dict[Any, str | None] = {}

    def put(self, node: Node, prim: Any) -> None:
        """The mesh and looks of a Gprim."""
        parts = self._parts(prim)
        key = (self._source(prim), *(self._reads(part.look) for part in parts))
        if key not in self._meshes:
            self._meshes[key] = self._made(node.path, prim, parts)
        node.mesh = self._meshes[key]
        if node.mesh is not None:
            node.looks = [part.look for part in parts]

    def _source(self, prim: Any) -> str:
        """Path of the prim, or of its prototype's, which instances share."""
        found = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        return str(found.GetPath())

    def _reads(self, look: str) -> tuple[Any, ...]:
        """Primvars and colours of a mesh that a look reads."""
        found = self.context.model.looks[look]
        return (*found.primvars, found.colors)

    def _made(self, path: str, prim: Any, parts: list[Part]) -> str | None:
        geometry: Geometry | None
        vertices = np.zeros(0, int)
        if prim.IsA(UsdGeom.Mesh):
            looks = [self.context.model.looks[part.look] for part in parts]
            faces = [part.faces for part in parts]
            found = meshes.geometry(self.context, UsdGeom.Mesh(prim), faces, looks)
            geometry, vertices = found or (None, vertices)
        elif prim.IsA(UsdGeom.BasisCurves):
            geometry = curves.geometry(self.context, prim)
            if any(self.context.model.looks[part.look].primvars for part in parts):
                self.context.note(prim, "its textures go along and around it, by no primvar")
        else:
            geometry = gprims.geometry(self.context, prim)
        if geometry is None:
            return None
        if len(parts) > 1:
            geometry["part_names"] = [part.name for part in parts]
        name = path
        while name in self.context.model.meshes:
            name += "'"
        self.context.model.meshes[name] = geometry
        self.vertices[name] = vertices
        return name

    def _parts(self, prim: Any) -> list[Part]:
        api = UsdShade.MaterialBindingAPI(prim)
        subsets = api.GetMaterialBindSubsets() if prim.IsA(UsdGeom.Mesh) else []
        parts = []
        for subset in subsets:
            faces = np.asarray(self.context.value(subset.GetIndicesAttr()) or (), dtype=int)
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                self.context.note(subset, "a subset of anything but faces is left out")
            elif len(faces):
                parts.append(Part(subset.GetPrim().GetName(), faces, self._look(subset.GetPrim())))
        return [Part("", None, self._look(prim)), *parts]

    def _look(self, prim: Any) -> str:
        bound = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)[0]
        if bound:
            return self.looks.of(bound)
        return self._display(prim if prim.IsA(UsdGeom.Gprim) else prim.GetParent())

    def _display(self, prim: Any) -> str:
        """A look of displayColor and displayOpacity."""
        color = self._constant(prim, "displayColor")
        opacity = self._constant(prim, "displayOpacity")
        if color == "varies" or opacity == "varies":
            alpha = {} if opacity is None else {"alpha_mode": "blend"}
            name = "displayColor" if opacity is None else "displayColor/blend"
            return self._kept(name, Look({"base_color": 1.0, **alpha}, colors=True))
        rgb = tuple(color or _GREY)[:3]
        alpha = {"alpha": opacity[0], "alpha_mode": "blend"} if opacity and opacity[0] < 1 else {}
        name = "/".join(f"{x:g}" for x in (*rgb, *((opacity or ())[:1] if alpha else ())))
        return self._kept(f"displayColor/{name}", Look({"base_color": rgb, **alpha}))

    def _constant(self, prim: Any, name: str) -> Any:
        """The one value of a primvar, clipped to [0, 1]; "varies"; None: it has none."""
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        found = self.context.value(primvar.GetAttr()) if primvar else None
        if found is None or not len(found):
            return None
        if len(found) > 1 and primvar.GetInterpolation() != UsdGeom.Tokens.constant:
            return "varies"
        return np.nan_to_num(np.clip(np.ravel(found[0]), 0, 1)).tolist()

    def _kept(self, name: str, look: Look) -> str:
        self.context.model.looks.setdefault(name, look)
        return name
