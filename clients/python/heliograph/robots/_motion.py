"""Poses of joints from their values, worked out where these are: by numpy, or by PyTorch on a GPU.
Used by kinematics.py."""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .._wire.arrays import NdArray
from .._wire.tensors import is_tensor
from .description import Joint

_TOLERANCE = 1e-6  # of limits: values may come as float32


class Motion:
    """Motion of M joints under C values, a joint's from column `first[name]` on; a mimic's follow.

    Angles and lengths are values @ weights + offsets, (C, M) and (M,).
    soft: values may be beyond the limits.
    bounds: (C,) each: the lower and upper limit, and the least and largest value that is accepted
    without clamping.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        first: Mapping[str, int],
        limits: NdArray,
        soft: bool = False,
    ) -> None:
        self._kind: dict[str, Any] = {}  # of tensors that are made; empty: by numpy
        self._tensors: dict[Any, Motion] = {}  # by device
        count = len(joints)
        weights, offsets = np.zeros((len(limits), count)), np.zeros(count)
        slides, crosses = np.zeros((count, 3)), np.zeros((count, 3, 3))
        self._planar: dict[int, tuple[int, Any]] = {}  # by joint: its first column, its plane
        self._floating: dict[int, int] = {}
        self._quaternions: dict[int, int] = {}
        by_name = {joint.name: joint for joint in joints}
        for i, joint in enumerate(joints):
            if joint.kind == "spherical":
                self._quaternions[i] = first[joint.name]
                continue
            if joint.kind == "floating":
                self._floating[i] = first[joint.name]
                self._quaternions[i] = first[joint.name] + 3
                continue
            if joint.kind == "planar":
                self._planar[i] = first[joint.name], _plane(joint.axis)
            source, factor, offset = _followed(joint, by_name)
            column = first[source.name] + (2 if joint.kind == "planar" else 0)
            weights[column, i], offsets[i] = factor, offset - (joint.rest[0] if joint.rest else 0)
            if joint.kind == "prismatic":
                slides[i] = joint.axis
            else:
                crosses[i] = _cross(joint.axis)
        origins = np.array([joint.origin for joint in joints]).reshape(count, 4, 4)
        self._arrays: Any = weights, offsets, slides, crosses, origins, np.eye(4)
        slack = _TOLERANCE * np.maximum(1, np.abs(np.nan_to_num(limits, posinf=1, neginf=1)))
        most = np.full_like(limits, (-np.inf, np.inf)) if soft else limits + slack * (-1, 1)
        self.bounds: Any = *limits.T, *most.T

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_tensors": {}}

    @property
    def _library(self) -> Any:
        return sys.modules["torch"] if self._kind else np

    def on(self, values: Any) -> Motion:
        """Motion as tensors on the device of `values`, where those are a tensor."""
        if not is_tensor(values):
            return self
        found = self._tensors.get(values.device)
        if found is None:
            found = self._tensors.setdefault(values.device, self._as_tensors(values.device))
        return found

    def _as_tensors(self, device: Any) -> Motion:
        made = copy.copy(self)
        made._kind = {"dtype": sys.modules["torch"].float64, "device": device}
        made._arrays, made.bounds = (
            tuple(made.constant(array) for array in arrays)
            for arrays in (self._arrays, self.bounds)
        )
        made._planar = {i: (at, made.constant(plane)) for i, (at, plane) in self._planar.items()}
        return made

    def constant(self, array: NdArray) -> Any:
        """A float64 array of the library that this one works with."""
        return self._library.asarray(array, **self._kind)

    def quaternions(self) -> Iterator[tuple[int, int]]:
        """Joints that turn freely, and the column where the quaternion w x y z of each begins."""
        return iter(self._quaternions.items())

    def follows(self, columns: Sequence[int]) -> NdArray:
        """(M,) bool: which joints are turned or slid by one of these columns."""
        moved: NdArray = np.any(self._arrays[0][columns] != 0, axis=0)
        return moved

    def amounts(self, values: Any) -> Any:
        """(..., M): how far they are turned or slid."""
        weights, offsets, *_ = self._arrays
        return values @ weights + offsets

    def angles(self, values: NdArray) -> NdArray:
        """(..., M) radians that they are turned about their axes."""
        turns = self._arrays[3].any(axis=(1, 2))
        return np.asarray(self.amounts(values) * turns)

    def local(self, values: Any) -> Any:
        """(..., M, 4, 4) float64 parent_from_child."""
        library = self._library
        _, _, slides, k, origins, one = self._arrays
        q = self.amounts(values)
        out = library.zeros((*q.shape, 4, 4), **self._kind)
        out[..., 3, 3] = 1
        sine, cosine = (f(q)[..., None, None] for f in (library.sin, library.cos))
        out[..., :3, :3] = one[:3, :3] + sine * k + (1 - cosine) * (k @ k)  # Rodrigues
        out[..., :3, 3] = q[..., None] * slides
        for i, (at, plane) in self._planar.items():
            out[..., i, :3, 3] = values[..., at : at + 2] @ plane
        for i, at in self._floating.items():
            out[..., i, :3, 3] = values[..., at : at + 3]
        for i, at in self._quaternions.items():
            out[..., i, :3, :3] = self._rotations(values[..., at : at + 4])
        return origins @ out

    def _rotations(self, wxyz: Any) -> Any:
        """(..., 3, 3) of unit quaternions (..., 4)."""
        w, v = wxyz[..., :1, None], wxyz[..., 1:]
        k = self._library.zeros((*v.shape, 3), **self._kind)
        for (i, j), n in {(2, 1): 0, (0, 2): 1, (1, 0): 2}.items():
            k[..., i, j], k[..., j, i] = v[..., n], -v[..., n]
        return self._arrays[-1][:3, :3] + 2 * w * k + 2 * k @ k

    def forward(self, values: Any, tree: Sequence[tuple[int, int, Any]]) -> Any:
        """(..., L, 4, 4) float64 root_from_link. tree: of each link but the first, which is the
        root, its place, its parent's, and the number of its joint or the pose that it keeps."""
        local = self.local(values)
        out = self._library.zeros((*values.shape[:-1], len(tree) + 1, 4, 4), **self._kind)
        out[..., 0, :, :] = self._arrays[-1]
        for link, parent, own in tree:
            step = local[..., own, :, :] if isinstance(own, int) else self.constant(own)
            out[..., link, :, :] = out[..., parent, :, :] @ step
        return out


def _followed(joint: Joint, joints: Mapping[str, Joint]) -> tuple[Joint, float, float]:
    """The joint that moves this one, with the factor and the offset of its value."""
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = joints[joint.mimic.joint]
    return joint, factor, offset


def _cross(axis: NdArray) -> NdArray:
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _plane(axis: NdArray) -> NdArray:
    """(2, 3): the joint's x and y axes, turned the shortest way from its z axis to `axis`."""
    x, y, z = axis
    if z < -1 + 1e-12:
        return np.array([[1.0, 0, 0], [0, -1.0, 0]])
    k = _cross(np.array([-y, x, 0.0]))  # z axis cross `axis`
    turn = np.eye(3) + k + k @ k / (1 + z)
    return np.asarray(turn[:, :2].T)
