"""Point instancers to packed groups. Needs pxr."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pxr import UsdGeom

from .._wire.arrays import NdArray
from .context import Context
from .model import Node, Pose


def read(
    context: Context, prim: Any, node: Node, prototype: Callable[[Any, str], list[Node]]
) -> None:
    """Nodes below that of the instancer: one group a prototype that is a single surface, else
    entities for each instance."""
    instancer = UsdGeom.PointInstancer(prim)
    if instancer.GetPositionsAttr().ValueMightBeTimeVarying():
        context.note(prim, "its instances move, and are taken as at one time")
    matrices = _matrices(context, instancer)
    which = np.asarray(context.value(instancer.GetProtoIndicesAttr()) or (), dtype=int)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    if len(which) != len(matrices) or (
        len(which) and not 0 <= which.min() <= which.max() < len(targets)
    ):
        context.note(prim, "its instances and their prototypes do not fit; it is left out")
        return
    taken: set[str] = set()
    shown = np.asarray(instancer.ComputeMaskAtTime(context.time) or np.ones(len(which)), dtype=bool)
    for number, target in enumerate(targets):
        here = np.flatnonzero((which == number) & shown)
        root = prim.GetStage().GetPrimAtPath(target)
        nodes = prototype(root, node.path) if root and len(here) else []
        if nodes:
            _place(context, node, nodes, (here, matrices[here]), taken)


def _matrices(context: Context, instancer: Any) -> NdArray:
    """(N, 4, 4) instancer_from_instance, the prototype's own transform left out."""
    found = instancer.ComputeInstanceTransformsAtTime(
        context.time,
        context.time,
        UsdGeom.PointInstancer.ExcludeProtoXform,
        UsdGeom.PointInstancer.IgnoreMask,
    )
    rows = np.array(found, dtype="f8").reshape(-1, 4, 4)
    return context.thick(instancer, rows.transpose(0, 2, 1))


def _place(
    context: Context,
    above: Node,
    nodes: list[Node],
    at: tuple[NdArray, NdArray],
    taken: set[str],
) -> None:
    """A packed group of a prototype that is one entity, else its entities for each instance.
    taken: paths of groups; prototypes may share their last name."""
    root, nodes_of = nodes[0], context.model.nodes
    if len(nodes) == 1 and not isinstance(root.pose, Mapping):
        path = f"{above.path}/{root.path.rpartition('/')[2]}"
        while path in taken:
            path += "'"
        taken.add(path)
        group = dataclasses.replace(root, path=path, transforms=at[1] @ root.pose)
        nodes_of.append(group)
        return
    for number, matrix in zip(*at):
        prefix = f"{above.path}/{number}"
        copies = [_copy(node, (root.path, prefix)) for node in nodes]
        copies[0].parent, copies[0].pose = above.path, _moved(matrix, root.pose)
        nodes_of.extend(copies)


def _copy(node: Node, names: tuple[str, str]) -> Node:
    """Copy of a node with paths beneath names[1] instead of names[0]."""
    old, new = names
    parent = None if node.parent is None else new + node.parent[len(old) :]
    return dataclasses.replace(node, path=new + node.path[len(old) :], parent=parent)


def _moved(matrix: NdArray, pose: Pose) -> Pose:
    if isinstance(pose, Mapping):
        return {t: matrix @ at for t, at in pose.items()}
    return np.asarray(matrix @ pose)
