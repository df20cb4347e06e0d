"""Files that generate() keeps, as it would make them, and faults to plant in them."""

from __future__ import annotations

import hashlib
from pathlib import Path

from heliograph._wire._proto import service_pb2 as service
from shapes_seen import write_json as put

OWN = ".heliograph"


BLOB, SCENE = b"an array", b"a scene"
NAME = hashlib.sha256(BLOB).hexdigest()


def make(root: Path) -> None:
    record = {"count": 3, "scene_sha256": hashlib.sha256(SCENE).hexdigest()}
    put(root / OWN / "dataset.json", record)
    (root / OWN / "scene.helio").write_bytes(SCENE)
    request = service.DecodeAssetRequest()
    request.files.add(path="a.exr", sha256=bytes.fromhex(NAME))
    for name, data in (
        (f"blobs/{NAME}", BLOB),
        (f"decodings/{64 * '1'}.bin", request.SerializeToString()),
    ):
        (root / OWN / name).parent.mkdir()
        (root / OWN / name).write_bytes(data)
    for i in range(3):
        for folder in ("records", "manifests"):
            put(root / OWN / folder / f"{i:06d}.json", {"record": {}})


FAULTS = {
    "record is no JSON": (
        "dataset.format",
        lambda root: (root / OWN / "records/000001.json").write_text("{"),
    ),
    "record removed": (
        "dataset.counts",
        lambda root: (root / OWN / "records/000001.json").unlink(),
    ),
    "manifest removed": (
        "dataset.counts",
        lambda root: (root / OWN / "manifests/000002.json").unlink(),
    ),
    "record beyond the count": (
        "dataset.counts",
        lambda root: put(root / OWN / "records/000009.json", {}),
    ),
    "blob changed": ("dataset.kept", lambda root: (root / OWN / "blobs" / NAME).write_bytes(b"")),
    "blob removed": ("dataset.kept", lambda root: (root / OWN / "blobs" / NAME).unlink()),
    "scene of another set": (
        "dataset.kept",
        lambda root: (root / OWN / "scene.helio").write_bytes(BLOB),
    ),
    "decoding torn": (
        "dataset.format",
        lambda root: (root / OWN / f"decodings/{64 * '1'}.bin").write_bytes(b"\xff\xff"),
    ),
    "files of the format are gone": (
        "dataset.files",
        lambda root: put(
            root / OWN / "dataset.json", {"count": 3, "writer": {"format": "NerfTransforms"}}
        ),
    ),
    "half a file": ("dataset.partial", lambda root: put(root / OWN / "partial/1-000001.png", {})),
}
