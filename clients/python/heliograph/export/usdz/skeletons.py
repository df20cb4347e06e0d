"""Skins to UsdSkel: each skinned mesh below a SkelRoot of its own. Needs pxr.

Joints are entities anywhere in the scene: a skeleton lists them side by side, at the poses that
they have in the world, so that their ancestors may move.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Gf, Tf, UsdSkel, Vt

from ..._wire.arrays import NdArray
from ...values.rotations import quaternions_of
from ..geometry import Geometry
from ..motion import Poses, polar
from ..world import Entity, World, key_of
from .stage import FRAMES, Stage, matrix_of

_FRAMES = 10_000  # of a clip; of longer ones the keys are written


class Skeletons:
    """Puts skeletons and their animations into a stage."""

    def __init__(self, world: World, stage: Stage, poses: Poses) -> None:
        self.world = world
        self.stage = stage
        self.poses = poses

    def root(self, path: str) -> Any:
        return UsdSkel.Root.Define(self.stage.stage, path).GetPrim()

    def bind(self, root: str, mesh: Any, entity: Entity, geometry: Geometry) -> None:
        """Makes a mesh below a root follow the joints of its entity."""
        skin = entity.message.skin
        joints = [key for key in map(key_of, skin.joints) if key is not None]
        binds = np.linalg.inv(np.asarray(self.world.array(skin.inverse_binds), dtype="f8"))
        skeleton = UsdSkel.Skeleton.Define(self.stage.stage, self.stage.path(root, "skeleton"))
        skeleton.CreateJointsAttr(self._names(joints))
        skeleton.CreateBindTransformsAttr([matrix_of(m) for m in binds])
        skeleton.CreateRestTransformsAttr([matrix_of(self.poses.world_now(j)) for j in joints])
        animation = self._animation(root, joints)
        own = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
        own.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
        if geometry.influences is not None:
            indices, weights = (part.ravel() for part in geometry.influences)
            binding.CreateJointIndicesPrimvar(False, 4).Set(
                Vt.IntArray.FromNumpy(indices.astype("i4"))
            )
            binding.CreateJointWeightsPrimvar(False, 4).Set(Vt.FloatArray.FromNumpy(weights))

    def _names(self, joints: list[int]) -> list[str]:
        found: list[str] = []
        for key in joints:
            stem = name = Tf.MakeValidIdentifier(self.world.entities[key].name or f"joint_{key}")
            while name in found:
                name += "_"
            found.append(name if name != stem else stem)
        return found

    def _animation(self, root: str, joints: list[int]) -> Any:
        """Poses of the joints in the world, at all keys of theirs and of their ancestors."""
        path = self.stage.path(root, "animation")
        animation = UsdSkel.Animation.Define(self.stage.stage, path)
        animation.CreateJointsAttr(self._names(joints))
        times = self._times(joints)
        if not len(times):
            self._put(animation, joints, self.world.time, ())
        for time in times:
            self._put(animation, joints, float(time), (self.stage.code(time),))
        return animation

    def _times(self, joints: list[int]) -> NdArray:
        """Keys, and frames between them: the way of a joint in the world is no straight line."""
        keys = np.unique(np.concatenate([self.poses.times_above(joint) for joint in joints]))
        if len(keys) < 2 or (keys[-1] - keys[0]) * FRAMES > _FRAMES:
            return keys
        frames = np.arange(math.ceil(keys[0] * FRAMES), math.floor(keys[-1] * FRAMES) + 1) / FRAMES
        return np.unique(np.concatenate([keys, frames]))

    def _put(self, animation: Any, joints: list[int], time: float, at: tuple[Any, ...]) -> None:
        matrices = np.stack([self.poses.world_at(joint, time) for joint in joints])
        rotations, stretches = polar(matrices[:, :3, :3])
        scales = np.diagonal(stretches, axis1=1, axis2=2)
        quats = [Gf.Quatf(*q) for q in quaternions_of(rotations).tolist()]
        moves = np.ascontiguousarray(matrices[:, :3, 3], dtype="f4")
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray.FromNumpy(moves), *at)
        animation.CreateRotationsAttr().Set(Vt.QuatfArray(quats), *at)
        sizes = [Gf.Vec3h(*s) for s in scales.tolist()]
        animation.CreateScalesAttr().Set(Vt.Vec3hArray(sizes), *at)
