"""UsdSkel: skeletons as entities, skins and blend shapes of meshes. Needs pxr.

A point p of a mesh goes to sum(weight J B^-1 G p) in the skeleton's frame: J of the joint now, B of
it in the bind pose, G the mesh's geomBindTransform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdSkel

from .._wire.arrays import NdArray
from ..values.skins import INFLUENCES, strongest
from .context import Context, matrix_of
from .model import Node


def put(context: Context, roots: Sequence[Any], vertices: Mapping[str, NdArray]) -> None:
    """Puts skins of meshes below SkelRoots. vertices: by mesh, the index of each vertex's point."""
    skins = _Skins(context, vertices)
    for root in roots:
        skins.add(root)


class _Skins:
    def __init__(self, context: Context, vertices: Mapping[str, NdArray]) -> None:
        self.context = context
        self.vertices = vertices
        self.cache = UsdSkel.Cache()
        self.nodes = {node.path: node for node in context.model.nodes}
        self.done: dict[str, str] = {}  # prefix of the paths of a skeleton's joints; "": none

    def add(self, root: Any) -> None:
        predicate = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        self.cache.Populate(root, predicate)
        for binding in self.cache.ComputeSkelBindings(root, predicate):
            skeleton = self.cache.GetSkelQuery(binding.GetSkeleton())
            for target in binding.GetSkinningTargets():
                node = self.nodes.get(str(target.GetPrim().GetPath()))
                if node is None:
                    self.context.note(target.GetPrim(), "skins of instances are left out")
                elif node.mesh is not None:
                    self._bind(skeleton, target, node)

    def _bind(self, skeleton: Any, target: Any, node: Node) -> None:
        if target.HasBlendShapes():
            self._put_shapes(skeleton, target, node)
        if not target.HasJointInfluences() or not self._put_joints(skeleton):
            return
        if str(target.GetSkinningMethod()) != UsdSkel.Tokens.classicLinear:
            self.context.note(node.path, f"{target.GetSkinningMethod()} skinning is done linearly")
        order = [str(joint) for joint in skeleton.GetJointOrder()]
        own = [str(joint) for joint in target.GetJointOrder() or order]
        if not set(own) <= set(order) or not self._put_influences(target, node, len(own)):
            self.context.note(node.path, "its joints do not fit its skeleton: its skin is left out")
            return
        geometry = matrix_of(target.GetGeomBindTransform(self.context.time))
        binds = [matrix_of(m) for m in skeleton.GetJointWorldBindTransforms()]
        inverse = [np.linalg.inv(binds[order.index(joint)]) @ geometry for joint in own]
        above = self.done[str(skeleton.GetPrim().GetPath())]
        node.joints = [f"{above}/{joint}" for joint in own], np.array(inverse)

    # ------------------------------------------------------------ joints

    def _put_joints(self, skeleton: Any) -> bool:
        """Entities of a skeleton's joints, once."""
        path = str(skeleton.GetPrim().GetPath())
        if path not in self.done:
            joints = self._joints(skeleton, path) if path in self.nodes else []
            self.context.model.nodes.extend(joints)
            if not joints:
                self.done[path] = ""
                self.context.note(path, "a skeleton without rest or bind transforms is left out")
        return bool(self.done[path])

    def _joints(self, skeleton: Any, path: str) -> list[Node]:
        poses = self._poses(skeleton)
        order = [str(joint) for joint in skeleton.GetJointOrder()]
        if len(poses) != len(order) or not skeleton.HasBindPose():
            return []
        above = path
        while any(f"{above}/{joint}" in self.nodes for joint in order):
            above += "'"
        self.done[path] = above
        topology = skeleton.GetTopology()
        nodes = []
        for number, (joint, pose) in enumerate(zip(order, poses)):
            place = topology.GetParent(number)
            parent = path if place < 0 else f"{above}/{order[place]}"
            nodes.append(Node(f"{above}/{joint}", parent, pose))
        return nodes

    def _poses(self, skeleton: Any) -> list[Any]:
        """Pose of each joint in the one above it, or its keys by time."""
        animation = skeleton.GetAnimQuery()
        samples = animation.GetJointTransformTimeSamples() if animation else []
        codes = self.context.codes(samples or [], steps=False)
        if len(codes) < 2:
            if samples and len(samples) > 1 and self.context.options.times is None:
                self.context.note(
                    skeleton.GetPrim(), 'it moves, and is taken as at one time: give times="all"'
                )
            return self._local(skeleton, self.context.time)
        keyed = {
            self.context.seconds(code): self._local(skeleton, Usd.TimeCode(code)) for code in codes
        }
        first = next(iter(keyed.values()))
        return [{t: local[i] for t, local in keyed.items()} for i in range(len(first))]

    def _local(self, skeleton: Any, time: Any) -> list[NdArray]:
        return [matrix_of(m) for m in skeleton.ComputeJointLocalTransforms(time) or ()]

    # ------------------------------------------------------------ meshes

    def _put_influences(self, target: Any, node: Node, joints: int) -> bool:
        """joints and weights of a mesh: the 4 that count most at each vertex."""
        found = target.ComputeJointInfluences(self.context.time)
        count = target.GetNumInfluencesPerComponent()
        if not found or not count:
            return False
        indices, weights = (np.asarray(part).reshape(-1, count) for part in found)
        mesh = str(node.mesh)
        points = self.vertices[mesh]
        if target.IsRigidlyDeformed():
            points = np.zeros_like(points)
        if points.max() >= len(weights) or not 0 <= indices.min() <= indices.max() < joints:
            return False
        if count > INFLUENCES:
            self.context.note(node.path, "a vertex follows 4 joints at most: the strongest taken")
        indices, weights = strongest(indices[points], weights[points])
        geometry = self.context.model.meshes[mesh]
        geometry["joints"], geometry["weights"] = indices, weights
        return True

    def _put_shapes(self, skeleton: Any, target: Any, node: Node) -> None:
        """morph_positions of a mesh and the weights of its entity."""
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(target.GetPrim()))
        offsets = [
            self._offsets(shapes.GetBlendShape(i), node) for i in range(shapes.GetNumBlendShapes())
        ]
        animation = skeleton.GetAnimQuery()
        if not animation or not offsets or any(one is None for one in offsets):
            self.context.note(node.path, "its blend shapes do not fit it or nothing weighs them")
            return
        self.context.model.meshes[str(node.mesh)]["morph_positions"] = np.stack(
            [one for one in offsets if one is not None]
        )
        codes = self.context.codes(animation.GetBlendShapeWeightTimeSamples() or [], steps=False)

        def weights(time: Any) -> NdArray:
            own = animation.ComputeBlendShapeWeights(time)
            mapped = target.GetBlendShapeMapper().Remap(own)
            return np.asarray(mapped, dtype="f4")

        node.rest["morph_weights"] = weights(self.context.time)
        if len(codes) > 1:
            keyed = {self.context.seconds(code): weights(Usd.TimeCode(code)) for code in codes}
            node.rest["morph_weights"] = keyed

    def _offsets(self, shape: Any, node: Node) -> NdArray | None:
        """(V, 3) of a blend shape; None: it does not fit the mesh."""
        if shape.GetInbetweens():
            self.context.note(shape, "inbetweens of blend shapes are left out")
        points = self.vertices[str(node.mesh)]
        given = np.asarray(shape.GetOffsetsAttr().Get() or (), dtype="f4").reshape(-1, 3)
        where = shape.GetPointIndicesAttr().Get()
        places = np.arange(len(given)) if where is None else np.asarray(where, dtype=int)
        if len(places) != len(given) or not len(given) or places.min() < 0:
            return None
        moved = np.zeros((max(int(points.max()), int(places.max())) + 1, 3), "f4")
        moved[places] = given
        found: NdArray = moved[points]
        return found
