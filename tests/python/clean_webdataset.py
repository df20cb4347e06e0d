"""Clean WebDataset shards by tarfile, and faults to plant in them."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import numpy as np
from clean_frames import frame, labels
from frame_faults import LABEL_FAULTS, PLANE_FAULTS
from PIL import Image
from shapes_seen import HEIGHT, WIDTH

Members = list[tuple[str, bytes]]
ARRAYS = (
    *("depth", "distance", "position", "position_camera", "normal", "normal_camera", "instance"),
    *("geometric_normal", "semantic", "part", "object_coordinates", "nocs", "beauty", "scene_flow"),
    *("flow_forward", "flow_forward_valid", "flow_forward_visible", "disparity:right"),
)


def sample(index: int, change=None) -> Members:
    """The members of a sample. change: as of frame_faults.py."""
    planes, content = frame(), labels(index)
    if change:
        change(planes, content)
    picture = io.BytesIO()
    Image.fromarray(np.full((HEIGHT, WIDTH, 3), 9, np.uint8)).save(picture, "PNG")
    out = [(f"{index:06d}.png", picture.getvalue())]
    out.append((f"{index:06d}.json", json.dumps(content).encode()))
    for name in ARRAYS:
        data = io.BytesIO()
        np.save(data, planes.get(name, np.zeros(1)))
        out.append((f"{index:06d}.{name.replace(':', '_')}.npy", data.getvalue()))
    return out


def save(path: Path, members: Members) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, "w") as archive:
        for name, data in members:
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))


def make(root: Path) -> None:
    save(root / "000000.tar", sample(0) + sample(1))
    save(root / "000001.tar", sample(2))


def first(change):
    """Writes the first shard anew. change: of its members, in two samples."""
    return lambda root: save(root / "000000.tar", change(sample(0), sample(1)))


def planted(change):
    return lambda root: save(root / "000000.tar", sample(0, change) + sample(1))


FAULTS = {
    "tar cut": (
        "webdataset.format",
        lambda root: (root / "000001.tar").write_bytes((root / "000000.tar").read_bytes()[:700]),
    ),
    "picture is none": (
        "webdataset.format",
        first(lambda a, b: [(a[0][0], b"\x89PNG"), *a[1:], *b]),
    ),
    "sample torn apart": ("webdataset.members", first(lambda a, b: [*a, *b, ("000000.txt", b"")])),
    "file without an ending": (
        "webdataset.members",
        first(lambda a, b: [*a, *b, ("README", b"")]),
    ),
    "plane missing": ("webdataset.endings", first(lambda a, b: [*a, *b[:-1]])),
    "sample twice": (
        "webdataset.keys",
        lambda root: save(root / "000001.tar", sample(1)),
    ),
    "JSON of another": (
        "webdataset.keys",
        planted(lambda planes, content: content.update(index=5)),
    ),
    "picture of another size": (
        "webdataset.pictures",
        first(lambda a, b: [(a[0][0], tiny()), *a[1:], *b]),
    ),
    "plane of another size": (
        "webdataset.sizes",
        planted(lambda planes, content: planes.update(depth=planes["depth"][1:])),
    ),
    "shard missing": (
        "webdataset.counts",
        lambda root: (root / "000000.tar").unlink(),
    ),
    **{
        name: (f"webdataset.{check}", planted(change))
        for name, (check, change) in (PLANE_FAULTS | LABEL_FAULTS).items()
    },
}


def tiny() -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.zeros((4, 5, 3), np.uint8)).save(out, "PNG")
    return out.getvalue()
