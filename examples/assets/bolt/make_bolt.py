"""Writes bolt.glb: a hexagon bolt of steel that lies on its side, 60 mm long, with a thread.

usage: make_bolt.py [OUT.glb]
"""

import json
import struct
import sys
from pathlib import Path

import numpy as np

LENGTH, RADIUS, PITCH, DEPTH = 0.052, 0.008, 0.0025, 0.0012  # of the shank, metres
HEAD, ACROSS, BEVEL = 0.010, 0.026, 0.0015  # its height, and across flats
PLAIN = 0.017  # of the shank, beneath the head
ROUND, RINGS = 40, 112


def shank():
    """(rings, around, 3), from the head down; the thread is a ridge that winds."""
    z = -np.linspace(0, LENGTH, RINGS)[:, None]
    angle = 2 * np.pi * np.arange(ROUND + 1)[None] / ROUND
    turn = (z / PITCH - angle / (2 * np.pi)) % 1
    groove = DEPTH * np.abs(2 * turn - 1)
    begun = np.clip((-z - PLAIN) / PITCH, 0, 1)  # runs out towards the head
    tip = np.clip((LENGTH + z) / 0.003, 0, 1)
    radius = (RADIUS - groove * begun) * (0.7 + 0.3 * tip)
    return np.stack(np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), z), axis=-1)


def head():
    """(rings, around, 3), from its middle on top to the shank; 6 sides of 6 columns each."""
    angle = 2 * np.pi * np.arange(6 * 6 + 1) / 36
    side = (angle + np.pi / 6) % (np.pi / 3) - np.pi / 6
    hexagon = ACROSS / 2 / np.cos(side)
    circle = np.full_like(angle, ACROSS / 2 - BEVEL / 2)
    rings = [
        (0 * circle, HEAD),
        (circle, HEAD),
        (np.minimum(hexagon, ACROSS / 2 + BEVEL), HEAD - BEVEL),
        (hexagon, HEAD - 2 * BEVEL),
        (hexagon, 0.0),
        (circle * 0.62, 0.0),
    ]
    return np.stack(
        [np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(r, z)], -1) for r, z in rings]
    )


def faces(grid):
    """(N, 3, 3) corners of the triangles of a grid, counter-clockwise seen from outside."""
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    both = [np.stack([a, d, c], 2), np.stack([a, c, b], 2)]
    corners = np.concatenate([each.reshape(-1, 3, 3) for each in both])
    return corners[np.linalg.norm(doubled_areas(corners), axis=1) > 1e-12]


def doubled_areas(corners):
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def flat(corners):
    normals = doubled_areas(corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.repeat(normals[:, None], 3, axis=1)


def smooth(corners):
    """Normals of the vertices, weighted by area."""
    places, index = np.unique(corners.reshape(-1, 3).round(7), axis=0, return_inverse=True)
    normals = np.zeros_like(places)
    np.add.at(normals, index.reshape(-1), np.repeat(doubled_areas(corners), 3, axis=0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals[index.reshape(-1)].reshape(corners.shape)


def tip():
    last = shank()[-1]
    centre = np.broadcast_to([0, 0, -LENGTH], last[:-1].shape)
    return np.stack([centre, last[1:], last[:-1]], axis=1)


def lying():
    """(3, 3): the axis from +Z to +X, dipped so that the tip and a side of the head rest on z."""
    dip = np.arcsin((ACROSS / 2 - 0.7 * (RADIUS - DEPTH / 2)) / LENGTH)
    return np.array([[-np.sin(dip), 0, np.cos(dip)], [0, 1, 0], [-np.cos(dip), 0, -np.sin(dip)]])


def main(path):
    edged, thread = np.concatenate([faces(head()), tip()]), faces(shank())
    corners = np.concatenate([edged, thread])
    normals = np.concatenate([flat(edged), smooth(thread)])
    rows = np.stack([corners, normals], axis=2) @ lying().T
    rows = rows[..., [0, 2, 1]] * [1, 1, -1]  # glTF: +Y up
    rows = np.round(rows.reshape(-1, 6), 6).astype("<f4") + np.float32(0)
    vertices, indices = np.unique(rows, axis=0, return_inverse=True)
    data = [vertices[:, :3].tobytes(), vertices[:, 3:].tobytes(), indices.astype("<u2").tobytes()]
    views, offset = [], 0
    for part in data:
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(part)})
        offset += len(part)
    float3 = {"componentType": 5126, "type": "VEC3", "count": len(vertices)}
    document = {
        "asset": {"version": "2.0", "generator": "make_bolt.py", "copyright": "Apache-2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "bolt", "mesh": 0}],
        "meshes": [
            {
                "name": "bolt",
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}
                ],
            }
        ],
        "materials": [
            {
                "name": "steel",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.56, 0.57, 0.58, 1],
                    "metallicFactor": 1,
                    "roughnessFactor": 0.32,
                },
            }
        ],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": [
            {
                **float3,
                "bufferView": 0,
                "min": vertices[:, :3].min(0).tolist(),
                "max": vertices[:, :3].max(0).tolist(),
            },
            {**float3, "bufferView": 1},
            {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": len(indices)},
        ],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    blob = b"".join(data)
    blob += b"\0" * (-len(blob) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A)
        + text
        + struct.pack("<II", len(blob), 0x004E4942)
        + blob
    )
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    print(
        f"{path}: {len(indices) // 3} triangles, {len(vertices)} vertices, {len(chunks) + 12} bytes"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("bolt.glb")))
