"""What generate() keeps, as it would be, and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

from shapes_seen import write_json as put

OWN = ".heliograph"


def make(root: Path) -> None:
    put(root / OWN / "dataset.json", {"count": 3})
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
    "half a file": ("dataset.partial", lambda root: put(root / OWN / "partial/1-000001.png", {})),
}
