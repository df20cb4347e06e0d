"""Poses of many entities in one packed message. Used by Edits.set_transforms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import types_pb2 as types
from .._wire.arrays import SHARED_BYTES, NdArray, bytes_of, describe
from ..errors import InvalidArgument
from ..values.pose import packed_matrices
from .handles import Entity, Group, Handle, flatten

if TYPE_CHECKING:
    from .._wire.lent import GpuArray
    from ..client.edit import Edits
    from ..client.scene import Scene


def placed(
    edits: Edits, entities: Any, transforms: Any
) -> tuple[list[Handle], types.Array, NdArray | GpuArray]:
    """(handles, ids, matrices): of entities that this transaction makes the handles; of others the
    ids, (N,) u64. A matrix for each, (N, 4, 4)."""
    matrices = packed_matrices(transforms)
    group = entities if isinstance(entities, Group) else None
    if group is not None and group._ids is not None:
        _check(len(group), len(matrices))
        return [], _again(edits, group), matrices
    listed = flatten(entities, "entities")
    _check(len(listed), len(matrices))
    handles = [e if isinstance(e, Handle) else Entity(edits.scene, e) for e in listed]
    if any(handle._edits is edits for handle in handles):
        return handles, types.Array(), matrices
    ids = packed_ids(edits.scene, handles)
    if group is not None:
        group._ids = ids, b""
    return [], edits.edited(ids), matrices


def _again(edits: Edits, group: Group) -> types.Array:
    """Many ids that were sent before travel once more, and from then on by their hash."""
    assert group._ids is not None
    ids, digest = group._ids
    if ids.nbytes < SHARED_BYTES:
        return edits.edited(ids)
    message = describe(ids)
    message.blob = edits.scene.client.store.blob(bytes_of(ids), digest)
    edits.sources.add(message.blob, bytes_of(ids))
    group._ids = ids, message.blob
    return message


def _check(entities: int, matrices: int) -> None:
    if entities != matrices:
        raise InvalidArgument(
            f"transforms: {matrices} matrices for {entities} entities; give as many",
            field="transforms",
        )


def packed_ids(scene: Scene, handles: Sequence[Handle]) -> NdArray:
    """(N,) u64; many names take one call."""
    unknown = [handle for handle in handles if not handle.known_id and handle._edits is None]
    if len(unknown) > 8:
        known = {found.name: found.id for found in scene._objects("")}
        for handle in unknown:
            handle._id = known.get(handle.name, 0)
    return np.array([handle.id for handle in handles], dtype="<u8")
