"""Files of models and volumes, as the daemon decodes them. Used by import_scene and
create_from_file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from heliograph._wire._proto import service_pb2 as service
from heliograph._wire.arrays import dtype_of

from . import daemon
from .checks import as_runtime_error
from .mesh_data import Arrays, of_data, smooth_normals


class Model(NamedTuple):
    """Model of a file. edits: that make its objects, in order. blobs: by SHA-256. warnings: of
    parts left out."""

    edits: Any
    blobs: dict[bytes, bytes]
    warnings: list[str]

    def array(self, message: Any) -> Any:
        """The numpy array of an Array message."""
        data = self.blobs[message.blob] if message.blob else message.inline
        return np.frombuffer(data, dtype_of(message.dtype)).reshape(tuple(message.shape))

    def of_kind(self, kind: str) -> Iterator[tuple[int, str, Any]]:
        """(index, name in the file, message) of each object of a kind."""
        for index, edit in enumerate(self.edits):
            if edit.WhichOneof("action") == kind:
                yield index, edit.target.name.partition("/")[2], getattr(edit, kind)


def read_model(path: str) -> Model:
    """Has a file decoded. RuntimeError with the reason where it cannot be."""
    if not os.path.isfile(path):
        raise RuntimeError(f"there is no file {path!r}")
    client = daemon.client()
    with as_runtime_error(), client.create_scene() as scratch:
        with scratch.edit() as edit:
            asset = edit.import_file(path, name="root")
        request = service.ExportSceneRequest(scene=scratch.id)
        return _exported(client.connection.stream("ExportScene", request), asset.warnings)


def _exported(chunks: Any, warnings: list[str]) -> Model:
    header, pieces, data = service.SceneChunk.Header(), b"", b""
    parts = []
    for chunk in chunks:
        kind = chunk.WhichOneof("part")
        if kind == "header":
            header = chunk.header
        elif kind == "header_chunk":
            pieces += chunk.header_chunk
        else:
            parts.append(chunk.chunk)
    if pieces:
        header.ParseFromString(pieces)
    data = b"".join(parts)
    blobs, at = {}, 0
    for digest, size in zip(header.blobs, header.sizes):
        blobs[digest] = data[at : at + size]
        at += size
    return Model(header.transaction.edits, blobs, warnings)


# ---------------------------------------------------------------- meshes


def pieces_of(model: Model, message: Any) -> list[Arrays]:
    """The parts of a mesh, each a mesh of its own."""
    given = {
        name: model.array(getattr(message, name))
        for name in ("positions", "indices", "normals", "uvs", "tangents", "parts", "colors")
        if message.HasField(name)
    }
    positions, indices = given["positions"], given["indices"]
    positions = positions[0] if positions.ndim == 3 else positions
    normals = given.get("normals")
    if normals is None:
        normals = smooth_normals(positions, indices)
    normals = normals[0] if normals.ndim == 3 else normals
    parts = given.get("parts", np.zeros(len(indices), "<u4"))
    out = []
    for part in range(int(parts.max(initial=0)) + 1):
        faces = indices[parts == part]
        used, inverse = np.unique(faces, return_inverse=True)
        normal, tangent, color, uv = (
            None if column is None else column[used].astype("f4")
            for column in (normals, given.get("tangents"), _colors(given), given.get("uvs"))
        )
        out.append(of_data(positions[used], normal, tangent, color, uv, inverse.reshape(-1)))
    return out


def _colors(given: dict[str, Any]) -> Any:
    colors = given.get("colors")
    if colors is None or colors.dtype.kind == "f":
        return colors
    return colors.astype("f4") / np.iinfo(colors.dtype).max


def local_pose(model: Model, message: Any) -> Any:
    """(4, 4) float64 of an Entity message, parent from local; at the first key."""
    if not message.HasField("pose"):
        return np.eye(4)
    matrices = model.array(message.pose.matrices).astype(float)
    return matrices[0] if matrices.ndim == 3 else matrices


def is_turn_to_z_up(name: str) -> bool:
    """True for the entity that turns glTF's +Y up to +Z: here coordinates stay those of the
    file."""
    return name == "z_up"


def merged_mesh(path: str) -> Arrays:
    """Joins the shapes of a file, each at its pose, into one mesh."""
    model = read_model(path)
    meshes = {index: message for index, _, message in model.of_kind("mesh")}
    poses: dict[int, Any] = {}
    parts = []
    for index, name, message in model.of_kind("entity"):
        local = np.eye(4) if is_turn_to_z_up(name) else local_pose(model, message)
        above = poses.get(message.parent.created_by_edit) if message.HasField("parent") else None
        poses[index] = local if above is None else above @ local
        if message.HasField("mesh"):
            shapes = pieces_of(model, meshes[message.mesh.created_by_edit])
            parts += [_placed(shape, poses[index]) for shape in shapes]
    if not parts:
        raise RuntimeError(f"{path} holds no mesh")
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    return Arrays(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.uvs for part in parts]),
        np.concatenate([p.indices + np.uint32(s) for p, s in zip(parts, starts)]),
        np.concatenate([part.colors for part in parts]),
        has_colors=any(part.has_colors for part in parts),
    )


def _placed(shape: Arrays, pose: Any) -> Arrays:
    positions = shape.positions @ pose[:3, :3].T + pose[:3, 3]
    normals = shape.normals @ np.linalg.inv(pose[:3, :3])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    indices = shape.indices[:, ::-1] if np.linalg.det(pose[:3, :3]) < 0 else shape.indices
    return shape._replace(
        positions=positions.astype("<f4"),
        normals=normals.astype("<f4"),
        indices=np.ascontiguousarray(indices),
    )


# ---------------------------------------------------------------- volumes


def read_volume(path: str) -> Any:
    """(X, Y, Z) float32 densities of a file's first volume, in voxels."""
    model = read_model(path)
    for _, _, message in model.of_kind("volume"):
        return dense(model, message.density)
    raise RuntimeError(f"{path} holds no volume")


def dense(model: Model, grid: Any) -> Any:
    """(X, Y, Z) float32 of a Grid message, bricks or not."""
    values = model.array(grid.values)
    if not grid.HasField("bricks"):
        return values
    bricks, box = model.array(grid.bricks), model.array(grid.box)
    first = bricks.min(axis=0)
    out = np.zeros(8 * (bricks.max(axis=0) - first + 1), "<f4")
    for place, brick in zip(8 * (bricks - first), values):
        x, y, z = place
        out[x : x + 8, y : y + 8, z : z + 8] = brick
    low, high = box - 8 * first
    full = np.zeros(high - low, "<f4")
    inner_low, inner_high = np.maximum(low, 0), np.minimum(high, out.shape)
    source = tuple(slice(a, b) for a, b in zip(inner_low, inner_high))
    target = tuple(slice(a - o, b - o) for a, b, o in zip(inner_low, inner_high, low))
    full[target] = out[source]
    return full
