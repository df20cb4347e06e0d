"""Poses of many entities in one packed message. Used by Edits.set_transforms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ._arrays import NdArray
from .errors import InvalidArgument
from .handles import Entity, Group, Handle, flatten
from .pose import packed_matrices

if TYPE_CHECKING:
    from ._lent import GpuArray
    from .edit import Edits
    from .scene import Scene


def placed(
    edits: Edits, entities: Any, transforms: Any
) -> tuple[list[Handle], NdArray, NdArray | GpuArray]:
    """(handles, ids, matrices): of entities that this transaction makes the handles; of others the
    ids, (N,) u64. A matrix for each, (N, 4, 4)."""
    matrices = packed_matrices(transforms)
    group = entities if isinstance(entities, Group) else None
    if group is not None and group._ids is not None:
        _check(len(group), len(matrices))
        return [], group._ids, matrices
    listed = flatten(entities, "entities")
    _check(len(listed), len(matrices))
    handles = [e if isinstance(e, Handle) else Entity(edits.scene, e) for e in listed]
    if any(handle._edits is edits for handle in handles):
        return handles, np.empty(0, "<u8"), matrices
    ids = packed_ids(edits.scene, handles)
    if group is not None:
        group._ids = ids
    return [], ids, matrices


def _check(entities: int, matrices: int) -> None:
    if entities != matrices:
        raise InvalidArgument(
            f"transforms: {matrices} matrices for {entities} entities; give as many",
            field="transforms",
        )


def packed_ids(scene: Scene, handles: Sequence[Handle]) -> NdArray:
    """(N,) u64; many names are asked for at once."""
    unknown = [handle for handle in handles if not handle.known_id and handle._edits is None]
    if len(unknown) > 8:
        known = {found.name: found.id for found in scene._objects("")}
        for handle in unknown:
            handle._id = known.get(handle.name, 0)
    return np.array([handle.id for handle in handles], dtype="<u8")
