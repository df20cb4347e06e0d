"""Common part of the scripts of all three renderers: renders each material under each of its
lights.

usage: RENDERER_side.py SPP CHUNKS OUT.npz [MATERIAL...]; what OUT holds already is kept.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import materials
import numpy as np
import setting

PictureOf = Callable[[int, int], Any]  # of samples per pixel and a seed: an array


def run(renderer: str, version: str, prepare: Callable[[materials.Row, str], PictureOf]) -> None:
    """prepare(row, light): sets up a scene; called for what is missing only."""
    spp, chunks, out = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    found = load(out) | {"version": np.array(version)}
    for row, light in materials.pictures(sys.argv[4:]):
        key = f"{row.name}|{light}|"
        if getattr(row, renderer) is None or key + "picture" in found:
            continue
        picture = prepare(row, light)
        measured = setting.measure(lambda seed: picture(spp, seed), chunks)
        found |= {key + part: values for part, values in measured.items()}
        save(out, found)
        print(f"{row.name}, {light}", flush=True)


def load(path: str) -> dict[str, Any]:
    if not os.path.exists(path):
        return {}
    with np.load(path) as found:
        return dict(found)


def save(path: str, found: dict[str, Any]) -> None:
    """Writes all of it or nothing, whenever the process is stopped."""
    part = path + ".part"
    with open(part, "wb") as file:
        np.savez(file, **found)
    os.replace(part, path)
