"""Worlds: copies of a scene that share all that they do not set themselves, rendered in one call.
Used by Scene.render_worlds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import render_pb2 as pb
from .._wire._proto import types_pb2 as types
from .._wire.arrays import Columns, NdArray, Store, checked, from_message
from .._wire.device import DeviceArray
from .._wire.lent import GpuArray, Loan, is_on_gpu
from .._wire.tensors import is_tensor, on_host
from ..errors import InvalidArgument
from ..robots.robot import Robot, Robots, listed
from ..scene.handles import Handle, flatten
from ..values.checks import whole_of
from .frame import Frame, Rendered

if TYPE_CHECKING:
    from .._wire.uploads import Sources
    from ..client.edit import Edits

_OWN = {"world", "camera", "keypoint_world", "keypoint_camera"}


class Worlds:
    """`count` copies of a scene, numbered from 0, for scene.render_worlds(). They share all that an
    overlay or a pose does not change, memory too; nothing is published.

    World i is the scene with the call's overlay, then its row of set_transforms(), then worlds[i].
    """

    def __init__(self, count: int, overlays: Sequence[Edits | None] = ()) -> None:
        self.count = whole_of(count, "count", 1)
        self._entities: list[types.Ref] = []
        self._matrices: NdArray | GpuArray | None = None
        self._teleport = False
        self._overlays: dict[int, Edits] = {}
        for i, overlay in enumerate(overlays):
            if overlay is not None:
                self[i] = overlay

    def __len__(self) -> int:
        return self.count

    def set_transforms(self, entities: Any, transforms: Any, *, teleport: bool = False) -> Worlds:
        """Sets the poses of M entities in each world: a group, an asset or a sequence of handles
        and names; (N, M, 4, 4), sent as one packed message. A second call replaces the first. An
        array on a GPU goes to the daemon's GPU, as it is at each call, without this host."""
        listed = flatten(entities, "entities")
        shape = (self.count, len(listed), 4, 4)
        self._matrices = (
            GpuArray(transforms, "transforms", ("<f4", "<f8"), shape)
            if is_on_gpu(transforms)
            else checked(on_host(transforms), "transforms", "<f4", shape)
        )
        self._entities = [e.ref() if isinstance(e, Handle) else types.Ref(name=e) for e in listed]
        self._teleport = teleport
        return self

    def set_joints(self, robot: Robots, values: Any, *, clamp: bool = False) -> Worlds:
        """Moves the joints of a robot in each world, (N, C) in the order of robot.joint_names, or
        of K robots with the same joints, (N, K, C); as set_transforms(), which it replaces. Values
        in a tensor of PyTorch give poses on the tensor's device, which stay there on a GPU."""
        robots = listed(robot)
        shape = (self.count,) if isinstance(robot, Robot) else (self.count, len(robots))
        shape = (*shape, len(robots[0].joint_names))
        if not (is_tensor(values) and values.shape == shape):
            values = checked(on_host(values), "values", "f8", shape)
        local = robots[0].transforms(values.reshape(-1, shape[-1]), clamp=clamp)
        moving = [entity for each in robots for entity in each.moving]
        return self.set_transforms(moving, local.reshape(self.count, len(moving), 4, 4))

    def __setitem__(self, world: int, overlay: Edits) -> None:
        """The edits, of scene.overlay(), that one world has for itself."""
        if not 0 <= world < self.count:
            raise InvalidArgument(
                f"world: {world} is not one of {self.count}, counted from 0", field="world"
            )
        self._overlays[int(world)] = overlay

    def __getitem__(self, world: int) -> Edits:
        return self._overlays[world]

    @property
    def sources(self) -> list[Sources]:
        """Uploads and decodings that the worlds' overlays name by hash."""
        return [overlay.sources for overlay in self._overlays.values()]

    def put(self, message: pb.Worlds, store: Store, mask: Any) -> Loan | None:
        """Fills the message of one call; large arrays are handed over, each for one use. The loan,
        if there is one, must live until the call is over."""
        loan = None
        message.count = self.count
        if self._matrices is not None and self._entities:
            message.poses.entities.extend(self._entities)
            if isinstance(self._matrices, GpuArray):
                matrices, loan = store.lent(self._matrices)
            else:
                matrices = store.edited(self._matrices)
            message.poses.matrices.CopyFrom(matrices)
            message.poses.teleport = self._teleport
        for world in range(max(self._overlays, default=-1) + 1):
            overlay = message.overlays.add()
            if world in self._overlays:
                overlay.CopyFrom(self._overlays[world].transaction)
        if mask is not None:
            given = checked(mask, "mask", "|u1", (self.count,))
            message.mask.CopyFrom(store.edited(given))
        return loan

    def __repr__(self) -> str:
        return f"<Worlds: {self.count}, {len(self._overlays)} with overlays>"


class WorldFrame(Rendered):
    """The pictures of R worlds through C cameras, packed.

    frame["depth"]: (R, C, H, W) or (R, C, H, W, channels), read-only. worlds (R,): which ones, in
    order; seeds (R,): of their random numbers. K (R, C, 3, 3), camera_from_world_cv (R, C, 4, 4).
    labels: columns over the instances of all pictures, with columns `world` and `camera`.
    """

    def __init__(self, header: pb.FrameHeader, arrays: Sequence[NdArray | DeviceArray]) -> None:
        super().__init__(header, arrays)
        self.cameras = list(header.worlds.cameras)

    @cached_property
    def worlds(self) -> NdArray:
        return from_message(self._header.worlds.worlds)

    @cached_property
    def seeds(self) -> NdArray:
        return from_message(self._header.worlds.seeds)

    def frame(self, world: int, camera: int = 0) -> Frame:
        """Frame of a world, by its number, through a camera, by its index in `cameras`.
        KeyError."""
        rows = np.flatnonzero(self.worlds == world)
        if not rows.size or not 0 <= camera < len(self.cameras):
            raise KeyError(f"there is no picture of world {world} through camera {camera}")
        at = int(rows[0]), camera
        header = pb.FrameHeader()
        header.CopyFrom(self._header)
        for name in ("worlds", "labels"):
            header.ClearField(name)
        header.frame, header.camera = camera, self.cameras[camera]
        header.seed = int(self.seeds[at[0]])
        _put_matrix(header.k, self.K[at])
        _put_matrix(header.camera_from_world_cv, self.camera_from_world_cv[at])
        if self._header.worlds.shutters:
            number = at[0] * len(self.cameras) + camera
            header.shutter.CopyFrom(self._header.worlds.shutters[number])
        header.labels.extend(self._labels_of(world, camera))
        return Frame(header, [self[name][at] for name in self])

    def _labels_of(self, world: int, camera: int) -> list[pb.LabelColumn]:
        out = []
        for message in self._header.labels:
            if message.name not in _OWN:
                prefix = "keypoint_" if message.name.startswith("keypoint_") else ""
                worlds, cameras = self.labels[prefix + "world"], self.labels[prefix + "camera"]
                out.append(
                    _some_rows(message, self.labels, (worlds == world) & (cameras == camera))
                )
        return out

    def __repr__(self) -> str:
        planes = ", ".join(self.planes)
        return (
            f"<WorldFrame of {len(self.worlds)} worlds, {len(self.cameras)} cameras, "
            f"{self.width}x{self.height}, {self.samples} spp: {planes}>"
        )


def _put_matrix(message: types.Array, matrix: NdArray) -> None:
    del message.shape[:]
    message.shape.extend(matrix.shape)
    message.inline = matrix.tobytes()


def _some_rows(message: pb.LabelColumn, labels: Columns, rows: NdArray) -> pb.LabelColumn:
    """A column's rows where `rows` (N,) bool."""
    column = labels[message.name]
    out = pb.LabelColumn(name=message.name, dtype=message.dtype)
    if isinstance(column, list):
        out.strings.extend(text for text, is_in in zip(column, rows) if is_in)
    else:
        kept = column[rows]
        out.shape.extend(kept.shape)
        out.data = kept.tobytes()
    return out
