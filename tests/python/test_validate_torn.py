"""Whatever a file holds, validate() answers with faults, not with an exception of its own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import heliograph.datasets as hd
import numpy as np
import pytest
from test_validate import SETS

JUNK = (None, "x", [], {}, -1, 0, 2.5, True, [1], [[1, 2], [3]], 10**30, "é" * 9)
SEEDS = range(3)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    root = tmp_path_factory.mktemp("torn")
    for name, module in SETS.items():
        module.make(root / name)
    return root


def junk_put_in(content, rng):
    """Replaces or removes one node of a JSON value, chosen level by level."""
    node = content
    while True:
        keys = list(node) if isinstance(node, dict) else range(len(node))
        key = keys[int(rng.integers(len(keys)))]
        inner = node[key]
        if isinstance(inner, (dict, list)) and inner and rng.random() < 0.85:
            node = inner
            continue
        if isinstance(node, dict) and rng.random() < 0.3:
            del node[key]
        else:
            node[key] = JUNK[int(rng.integers(len(JUNK)))]
        return


def tear(path: Path, rng) -> None:
    data = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.8:
        content = json.loads(data)
        junk_put_in(content, rng)
        path.write_text(json.dumps(content))
    elif rng.random() < 0.5 or not data:
        path.write_bytes(data[: int(rng.integers(len(data) + 1))])
    else:
        torn = bytearray(data)
        for at in rng.integers(0, len(torn), 8):
            torn[at] = int(rng.integers(256))
        path.write_bytes(bytes(torn))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", SETS)
def test_torn_files_are_answered(name, seed, clean, tmp_path):
    rng = np.random.default_rng([seed, len(name)])
    root = tmp_path / name
    shutil.copytree(clean / name, root)
    paths = sorted(path for path in root.rglob("*") if path.is_file())
    described = [path for path in paths if path.suffix not in (".png", ".flo")]
    chosen = described if described and rng.random() < 0.8 else paths
    for at in rng.permutation(len(chosen))[:3]:
        tear(chosen[at], rng)
    report = hd.validate(root, name)
    assert report.formats == [name] and all(fault.message for fault in report.faults)
