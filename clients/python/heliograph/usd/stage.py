"""A USD file to a Model: opens the stage and walks it. Needs pxr."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel

from ..errors import InvalidArgument, NotFound
from . import articulations, cameras, instancers, labels, lights, skeletons, surfaces
from .context import Context
from .files import Files
from .model import Model, Node, Options

PURPOSES = ("default", "render", "proxy", "guide")
INSTANCES = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


def read(path: Path, options: Options) -> tuple[Model, Files]:
    """Reads a USD file by the options; returns its model and the files of its textures."""
    for purpose in options.purposes:
        if purpose not in PURPOSES:
            raise InvalidArgument(
                f"purposes: of {', '.join(PURPOSES)}, not {purpose!r}", field="purposes"
            )
    stage = _opened(path, options)
    _choose(stage, options.variants)
    up = UsdGeom.GetStageUpAxis(stage).lower()
    model = Model(path.stem, _metres(stage, options.units), up)
    files = Files(path, options.folders)
    context = Context(stage, options, model, files)
    if UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        if options.units:
            context.note("/", "it names its metersPerUnit, which comes before units=")
    elif not options.units:
        context.note("/", "it names no metersPerUnit: 0.01 taken; give units= for another")
    for left in () if options.payloads else stage.FindLoadable():
        context.note(left, "its payload is left out, as payloads=False asks")
    walk = _Walk(context)
    walk.children(stage.GetPseudoRoot(), _Above())
    skeletons.put(context, walk.skinned, walk.surfaces.vertices)
    articulations.put(context)
    return model, files


def _opened(path: Path, options: Options) -> Any:
    if not path.is_file():
        raise NotFound(f"no file {path}", field="path")
    load = Usd.Stage.LoadAll if options.payloads else Usd.Stage.LoadNone
    try:
        return Usd.Stage.Open(str(path), load)
    except Tf.ErrorException as error:
        raise InvalidArgument(f"{path} cannot be read as USD: {error}", field="path") from None


def _choose(stage: Any, variants: Mapping[str, Mapping[str, str]]) -> None:
    """Selects variants in the session's layer: the file stays as it is."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path, wanted in variants.items():
            if not Sdf.Path.IsValidPathString(path) or not stage.GetPrimAtPath(path):
                raise NotFound(f"variants: the stage has no prim {path!r}", field="variants")
            for name, variant in wanted.items():
                _select(stage.GetPrimAtPath(path).GetVariantSets(), path, name, variant)


def _select(sets: Any, path: str, name: str, variant: str) -> None:
    if name not in sets.GetNames():
        have = ", ".join(sets.GetNames()) or "none"
        raise NotFound(f"variants: {path} has no set {name!r}; it has {have}", field="variants")
    chosen = sets.GetVariantSet(name)
    if variant not in chosen.GetVariantNames():
        have = ", ".join(chosen.GetVariantNames()) or "none"
        raise NotFound(
            f"variants: {name} of {path} has no {variant!r}; it has {have}", field="variants"
        )
    chosen.SetVariantSelection(variant)


def _metres(stage: Any, units: float) -> float:
    """Metres per unit; `units` where the file has none."""
    found = float(UsdGeom.GetStageMetersPerUnit(stage))
    if units and not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        found = units
    if not (math.isfinite(found) and found > 0):
        raise InvalidArgument(f"metersPerUnit: {found} is not above 0; correct it", field="units")
    return found


@dataclass
class _Above:
    """Properties that a prim inherits from those above it."""

    node: str | None = None  # the nearest one that is an entity
    hidden: bool = False  # by a prim between it and that
    purpose: Any = None  # Imageable.PurposeInfo


class _Walk:
    """Makes nodes of prims, those above first."""

    def __init__(self, context: Context) -> None:
        self.context = context
        self.surfaces = surfaces.Surfaces(context)
        self.skinned: list[Any] = []  # SkelRoots
        self.prototypes: list[Any] = []  # that are being read, each within the one before

    def children(self, prim: Any, above: _Above) -> None:
        for child in prim.GetFilteredChildren(INSTANCES):
            self.visit(child, above)

    def visit(self, prim: Any, above: _Above) -> None:
        for error in prim.GetPrimIndex().localErrors:
            self.context.note(prim, f"it is not composed whole: {error}")
        imageable = UsdGeom.Imageable(prim)
        if not imageable:
            self.children(prim, above)
            return
        hidden = self._hidden(imageable) or above.hidden
        purpose = above.purpose
        info = imageable.ComputePurposeInfo(purpose) if purpose else imageable.ComputePurposeInfo()
        if not prim.IsA(UsdGeom.Xformable):
            self.children(prim, _Above(above.node, hidden, info))
            return
        node = self._node(prim, above, hidden)
        if prim.IsA(UsdSkel.Root):
            self.skinned.append(UsdSkel.Root(prim))
        wanted = str(info.purpose) in self.context.options.purposes
        self._fill(node, prim, wanted)
        if not prim.IsA(UsdGeom.PointInstancer):
            self.children(prim, _Above(node.path, False, info))
        elif wanted:
            instancers.read(self.context, prim, node, self._prototype)

    def _hidden(self, imageable: Any) -> bool:
        visibility = imageable.GetVisibilityAttr()
        if len(visibility.GetTimeSamples()) > 1:
            self.context.note(imageable, "its visibility changes, and is taken as at one time")
        return bool(self.context.value(visibility) == UsdGeom.Tokens.invisible)

    def _node(self, prim: Any, above: _Above, hidden: bool) -> Node:
        xformable = UsdGeom.Xformable(prim)
        parent = None if xformable.GetResetXformStack() else above.node
        node = Node(str(prim.GetPath()), parent, self.context.pose(xformable, parent is None))
        if hidden:
            node.rest["visible"] = False
        node.rest.update(labels.of(prim, self.context.options.semantics))
        self.context.model.nodes.append(node)
        return node

    def _fill(self, node: Node, prim: Any, wanted: bool) -> None:
        """Fills a node with the components of a prim, besides its pose."""
        if wanted and self.context.options.lights:
            lights.put(self.context, node, prim)
        if prim.IsA(UsdGeom.Camera):
            cameras.put(self.context, node, prim)
        elif wanted and prim.IsA(UsdGeom.Gprim):
            self.surfaces.put(node, prim)

    def _prototype(self, prim: Any, above: str) -> list[Node]:
        """The nodes of a prototype, its own first; they are taken from the model again."""
        if prim.GetPath() in self.prototypes:
            self.context.note(prim, "a prototype within itself is left out")
            return []
        nodes = self.context.model.nodes
        start = len(nodes)
        self.prototypes.append(prim.GetPath())
        self.visit(prim, _Above(above))
        self.prototypes.pop()
        found = nodes[start:]
        del nodes[start:]
        return found
