"""Meshes of geoms and sites: primitives, meshes, height fields. Used by edits.py.

Texture coordinates have u to the right and v up, as in all of Heliograph; MuJoCo counts v down.
Source: MuJoCo's manual, "XML Reference", material: texrepeat, texuniform.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...values import shapes
from .cubes import wrapped
from .reading import Compiled, mujoco

if TYPE_CHECKING:
    from ...scene.patches import Geometry


@dataclass(frozen=True)
class Shape:
    """Key of a mesh. kind: "box". size: MuJoCo's. data: number of a mesh or a height field, -1 for
    none. repeat: of a picture over the object, None for none. cube: for a texture on six faces,
    their number and the texels along their sides, None for none; uniform: True if it is laid on the
    object as it is, False if on one of equal sides."""

    kind: str
    size: tuple[float, float, float]
    data: int = -1
    repeat: tuple[float, float] | None = None
    cube: tuple[int, int] | None = None
    uniform: bool = False


_KINDS = ("PLANE", "HFIELD", "SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH", "SDF")


def kind_of(number: int) -> str:
    """Kind of an mjtGeom, in lower case."""
    kinds = {int(getattr(mujoco().mjtGeom, f"mjGEOM_{kind}")): kind.lower() for kind in _KINDS}
    return kinds.get(int(number), f"type {number}")


def geometry(source: Compiled, shape: Shape) -> Geometry:
    """Arguments of edit.mesh()."""
    if shape.kind in ("mesh", "sdf"):
        out = _mesh(source.model, shape.data)
    elif shape.kind == "hfield":
        out = _height_field(source.model, shape.data)
    else:
        out = _primitive(source, shape)
    if shape.repeat is not None:
        out["uvs"] = _repeated(out, shape, np.array(shape.repeat))
    elif "uvs" in out:
        del out["uvs"]
    return out if shape.cube is None else _wrapped(out, shape, shape.cube)


def _wrapped(given: Geometry, shape: Shape, cube: tuple[int, int]) -> Geometry:
    """Geometry with a texture of six faces about it."""
    indices = np.asarray(given["indices"])
    positions = np.asarray(given["positions"], "f8")
    normals = given.get("normals")
    vertices = positions if normals is None else np.column_stack([positions, normals])
    half = np.abs(positions).max(0)
    scale = np.ones(3) if shape.uniform or shape.data >= 0 else 1 / np.where(half > 0, half, 1.0)
    corners, uvs = wrapped(vertices[indices], scale, cube)
    out: Geometry = {
        "positions": corners[..., :3].reshape(-1, 3),
        "indices": np.arange(3 * len(corners)).reshape(-1, 3),
        "uvs": uvs.reshape(-1, 2),
    }
    if normals is not None:
        out["normals"] = corners[..., 3:].reshape(-1, 3)
    return out


def _primitive(source: Compiled, shape: Shape) -> Geometry:
    x, y, _ = shape.size
    if shape.kind == "plane":
        return _scaled(shapes.plane(2.0), plane_size(source, shape.size))
    if shape.kind == "sphere":
        return shapes.sphere(x)
    if shape.kind == "ellipsoid":
        return _scaled(shapes.sphere(1.0), shape.size)
    if shape.kind == "capsule":
        return shapes.capsule(x, 2 * y)
    if shape.kind == "cylinder":
        return shapes.cylinder(x, 2 * y)
    return _scaled(shapes.cube(2.0), shape.size)


def plane_size(source: Compiled, size: tuple[float, ...]) -> tuple[float, float, float]:
    """Half of its sides: infinite ones end where MuJoCo's own renderer stops."""
    model = source.model
    far = float(model.vis.map.zfar * model.stat.extent)
    return size[0] or far, size[1] or far, 1.0


def _scaled(given: Geometry, size: tuple[float, ...]) -> Geometry:
    """Geometry scaled about the origin; normals stay across the surface."""
    normals = np.asarray(given["normals"]) / size
    return {
        **given,
        "positions": np.asarray(given["positions"]) * size,
        "normals": normals / np.linalg.norm(normals, axis=1, keepdims=True),
    }


def _repeated(given: Geometry, shape: Shape, repeat: NdArray) -> NdArray:
    """Texture coordinates (V, 2): those of the surface, or of a picture projected from above over
    the whole object, every two units on an infinite plane. MuJoCo repeats it from its upper left
    corner on."""
    half = np.array(shape.size[:2])
    if shape.kind == "plane" and not half.all():
        s, t = (0.5 * repeat * (1, -1) * np.asarray(given["positions"])[:, :2] - 0.5).T
    elif "uvs" in given:
        s, t = (repeat * (np.asarray(given["uvs"]) * (1, -1) + (0, 1))).T
    else:
        half = np.where(half > 0, half, 1.0)
        s, t = (repeat * (0.5 * np.asarray(given["positions"])[:, :2] / half * (1, -1) + 0.5)).T
    return np.column_stack([s, 1 - t])


def _mesh(model: Any, mesh: int) -> Geometry:
    """Corners that agree in position, normal and texture coordinates are one vertex."""
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = [model.mesh_face[faces].ravel(), model.mesh_facenormal[faces].ravel()]
    arrays = [
        _slice(model.mesh_vert, model.mesh_vertadr, model.mesh_vertnum, mesh),
        _slice(model.mesh_normal, model.mesh_normaladr, model.mesh_normalnum, mesh),
    ]
    if model.mesh_texcoordadr[mesh] >= 0:
        corners.append(model.mesh_facetexcoord[faces].ravel())
        coordinates = (model.mesh_texcoord, model.mesh_texcoordadr, model.mesh_texcoordnum)
        arrays.append(_slice(*coordinates, mesh))
    key = np.zeros(len(corners[0]), np.int64)
    for index, array in zip(corners, arrays):
        key = key * len(array) + index
    _, first, indices = np.unique(key, return_index=True, return_inverse=True)
    out: Geometry = {
        "positions": arrays[0][corners[0][first]],
        "normals": arrays[1][corners[1][first]],
        "indices": indices.reshape(-1, 3),
    }
    if len(arrays) > 2:
        out["uvs"] = arrays[2][corners[2][first]] * (1, -1) + (0, 1)
    return out


def _slice(values: Any, starts: Any, counts: Any, index: int) -> NdArray:
    start = int(starts[index])
    return np.array(values[start : start + int(counts[index])], "f4")


def _height_field(model: Any, field: int) -> Geometry:
    """The surface, on a box as deep as the field's base, with sides down to it; flat faces."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    x, y, top, base = model.hfield_size[field]
    heights = top * np.array(model.hfield_data[start : start + rows * columns])
    u, v = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
    surface = np.column_stack([u.ravel(), v.ravel(), heights])
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    up = np.concatenate([_rows(a, a + 1, a + columns + 1), _rows(a, a + columns + 1, a + columns)])
    places = np.arange(rows * columns).reshape(rows, columns)
    rim = np.concatenate([places[0, :-1], places[:-1, -1], places[-1, :0:-1], places[:0:-1, 0]])
    below = surface[rim] * (1, 1, 0) - (0, 0, base)
    low, count = len(surface) + np.arange(len(rim)), len(rim)
    after, low_after = np.roll(rim, -1), np.roll(low, -1)
    sides = np.concatenate([_rows(rim, low, low_after), _rows(rim, low_after, after)])
    middle = np.full(count, len(surface) + count)
    floor = _rows(middle, low_after, low)
    return {
        "positions": np.concatenate([surface, below, [[0, 0, -base]]]),
        "indices": np.concatenate([up, sides, floor]),
    }


def _rows(*columns: NdArray) -> NdArray:
    return np.column_stack(columns)
