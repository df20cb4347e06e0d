"""Arrays to the messages of volumes. Used by edit.py."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from .._wire._proto import scene_pb2 as pb
from .._wire.arrays import NdArray, checked, inline
from ..errors import InvalidArgument
from ..values.checks import color_of, number_of, refuse_unknown

if TYPE_CHECKING:
    from ..client.edit import Edits


class Medium(TypedDict, total=False):
    """Medium of a volume. Arrays of other sizes than the density's fill the same box."""

    density: Any  #: (X, Y, Z), >= 0: [i, j, k] is of the voxel there
    temperature: Any  #: (X, Y, Z), >= 0; None: nothing glows
    color: Any  #: (X, Y, Z, 3) in [0, 1], multiplies albedo; None: 1
    axes: str  #: order of the arrays' axes, "xyz"; for (D, H, W) arrays "zyx"
    voxel_size: Any  #: metres, a number or (3,), of the density's voxels; 1
    origin: Any  #: (3,) metres, the corner of voxel [0, 0, 0] in the entity's coordinates; 0
    density_scale: float | None  #: 1/m, >= 0: extinction of density 1; 1
    albedo: Any  #: [0, 1] a channel: share of the extinction that scatters; 0.8
    anisotropy: float | None  #: [-0.99, 0.99]: mean cosine of scattering, > 0: forwards; 0
    temperature_scale: float | None  #: kelvin of temperature 1, >= 0; 1
    emission_scale: float | None  #: >= 0: factor on the black body's radiance; 1


_GRIDS = ("density", "temperature", "color")
_PLACE = ("axes", "voxel_size", "origin")


def volume_message(edits: Edits, given: Mapping[str, Any]) -> pb.Volume:
    """The Volume of some Medium."""
    refuse_unknown(given, Medium, "a volume")
    out = pb.Volume()
    grids = {name: _in_xyz(given, name) for name in _GRIDS if given.get(name) is not None}
    for name, value in given.items():
        if name in _PLACE or name in grids:
            continue
        if value is None:
            out.clear.append(name)
        elif name == "albedo":
            out.albedo.CopyFrom(color_of(value, name))
        else:
            setattr(out, name, number_of(value, name))
    if grids:
        _put_grids(edits, out, given, grids)
    elif any(name in given for name in _PLACE):
        raise InvalidArgument(
            "axes, voxel_size and origin belong to arrays: give density too", field="density"
        )
    return out


def _in_xyz(given: Mapping[str, Any], name: str) -> NdArray:
    """The array with its axes in the order x, y, z."""
    axes = given.get("axes", "xyz")
    if sorted(axes) != ["x", "y", "z"]:
        raise InvalidArgument(f'axes: "x", "y" and "z" in some order, not {axes!r}', field="axes")
    shape = (None, None, None, 3) if name == "color" else (None, None, None)
    array = checked(given[name], name, "<f4", shape)
    order = [axes.index(axis) for axis in "xyz"]
    return np.ascontiguousarray(array.transpose(*order, *range(3, array.ndim)))


def _put_grids(
    edits: Edits, out: pb.Volume, given: Mapping[str, Any], grids: Mapping[str, NdArray]
) -> None:
    """Puts the grids; all fill the box that the density's voxels make. InvalidArgument."""
    if "density" not in grids:
        raise InvalidArgument(
            f"{next(iter(grids))}: give density with it, whose box it fills", field="density"
        )
    size = np.broadcast_to(np.asarray(given.get("voxel_size", 1.0), dtype=np.float64), (3,))
    if not (np.isfinite(size).all() and (size > 0).all()):
        raise InvalidArgument(f"voxel_size: {size} must be above 0", field="voxel_size")
    origin = checked(given.get("origin", (0.0, 0.0, 0.0)), "origin", "<f8", (3,))
    box = size * grids["density"].shape[:3]
    for name, array in grids.items():
        grid = getattr(out, name)
        grid.values.CopyFrom(edits.asset(array))
        matrix = np.diag([*(box / np.maximum(array.shape[:3], 1)), 1.0])
        matrix[:3, 3] = origin
        grid.transform.CopyFrom(inline(matrix))
