"""Clean Parquet tables by pyarrow, and faults to plant in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as arrow
import pyarrow.parquet
from clean_frames import labels
from frame_faults import LABEL_FAULTS
from shapes_seen import picture


def flat(row: dict) -> dict:
    """Matrices as one list, row by row."""
    return {
        k: np.ravel(v).tolist() if isinstance(v, list) and v and isinstance(v[0], list) else v
        for k, v in row.items()
    }


def tables(contents: list[dict]) -> dict[str, list[dict]]:
    out: dict[str, list[dict]] = {"images": [], "instances": [], "keypoints": []}
    for content in contents:
        index = content["index"]
        shot = {k: v for k, v in content.items() if k not in out}
        out["images"].append({**flat(shot), "file": f"images/{index:06d}.png"})
        for name in ("instances", "keypoints"):
            out[name] += [{"index": index, **flat(row)} for row in content[name]]
    return out


def save(root: Path, made: dict[str, list[dict]]) -> None:
    root.mkdir(parents=True, exist_ok=True)
    for name, rows in made.items():
        pyarrow.parquet.write_table(arrow.Table.from_pylist(rows), root / f"{name}.parquet")


def make(root: Path) -> None:
    for i in range(3):
        picture(root / f"images/{i:06d}.png", i)
    save(root, tables([labels(i) for i in range(3)]))


def planted(change):
    """change: as of frame_faults.py, of the first image."""

    def plant(root: Path) -> None:
        contents = [labels(i) for i in range(3)]
        change({}, contents[0])
        save(root, tables(contents))

    return plant


def rows(name: str, change):
    def plant(root: Path) -> None:
        made = tables([labels(i) for i in range(3)])
        change(made[name])
        save(root, made)

    return plant


FAULTS = {
    "table is none": (
        "parquet.format",
        lambda root: (root / "instances.parquet").write_bytes(b"PAR1"),
    ),
    "no column K": ("parquet.format", rows("images", lambda r: [row.pop("K") for row in r])),
    "image twice": ("parquet.ids", rows("images", lambda r: r.append(r[0]))),
    "label twice": ("parquet.ids", rows("instances", lambda r: r.append(r[0]))),
    "instance of no image": (
        "parquet.references",
        rows("instances", lambda r: r.append({**r[0], "index": 8})),
    ),
    "image left out": (
        "parquet.counts",
        lambda root: save(root, tables([labels(i) for i in (0, 2)])),
    ),
    "picture removed": (
        "parquet.image_files",
        lambda root: (root / "images/000002.png").unlink(),
    ),
    **{
        name: (f"parquet.{check}", planted(change))
        for name, (check, change) in LABEL_FAULTS.items()
    },
}
