"""Materials beside Mitsuba's and Cycles', by statistics that bench/materials_beside.py has stored.

A figure passes if it is within the material's bound of a peer's, as a part of the larger of the
figure and the mean of its disc, and LEVEL standard errors of both sides.
"""

from __future__ import annotations

import json
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import heliograph as hg
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]
sys.path.append(str(ROOT / "bench/beside"))
import materials  # noqa: E402
import ours_side  # noqa: E402
import setting  # noqa: E402

PEERS = json.loads((pathlib.Path(__file__).parent / "peers.json").read_text())
SPP, CHUNKS = 2, 16
LEVEL = 7.5  # Student's t with 15 degrees of freedom is beyond it twice in a million figures
DISC = setting.STATISTICS.index("disc")
# By material, perhaps under one light: how far its figures may be from a peer's of the same model.
BOUNDS = {
    "diffuse": {"mitsuba": 0.004, "cycles": 0.004},
    "glass 0 ior 1.5": {"mitsuba": 0.004, "cycles": 0.004},
    "glass 0.1 ior 1.5": {"mitsuba": 0.004, "cycles": 0.004},
    "glass 0.3 ior 1.5": {"cycles": 0.006},
    "glass 0.5 ior 1.5": {"cycles": 0.02},
    "glass 0.3 ior 1.33": {"cycles": 0.006},
    "glass 0.8 ior 1.33": {"cycles": 0.025},
    "glass 0.3 ior 2": {"cycles": 0.006},
    "glass 0.8 ior 2": {"cycles": 0.025},
    "glass, coloured": {"mitsuba": 0.004, "cycles": 0.004},
    "glass, absorbing": {"mitsuba": 0.004, "cycles": 0.004},
    "translucent": {"mitsuba": 0.008, "cycles": 0.004},
    "thin-walled 0": {"mitsuba": 0.004},
    "metal 0.2": {"mitsuba": 0.008, "cycles": 0.008},
    "metal 0.4, dome": {"cycles": 0.004},
    "metal 0.6, dome": {"cycles": 0.004},
    "metal 0.8, dome": {"cycles": 0.008},
    "metal 0.8 white, dome": {"cycles": 0.004},
    "plastic 0.1": {"mitsuba": 0.035},
    "plastic 0.6": {"cycles": 0.02},
}


def bounds(row: materials.Row, light: str) -> dict[str, float]:
    return BOUNDS.get(f"{row.name}, {light}", BOUNDS.get(row.name, {}))


COMPARED = [(row, light) for row, light in materials.pictures([]) if bounds(row, light)]


@pytest.fixture(scope="module")
def studio() -> Iterator[ours_side.Studio]:
    with hg.connect() as client:
        yield ours_side.Studio(client)


def measured(studio: ours_side.Studio, row: materials.Row, light: str) -> tuple[Any, Any]:
    """Means and standard errors of the statistics that are meaningful under a light."""
    picture = studio.prepare(row, light)
    chunks = setting.measure(lambda seed: picture(SPP, seed), CHUNKS)["statistics"]
    mean, error = setting.mean_and_error(chunks)
    kept = [setting.STATISTICS.index(name) for name in setting.wanted(light)]
    return mean[kept], error[kept]


def stored(row: materials.Row, light: str, peer: str) -> tuple[Any, Any]:
    figures = PEERS["values"][f"{row.name}, {light}"][peer]
    return np.array(figures["mean"]), np.array(figures["error"])


def excess(ours: tuple[Any, Any], theirs: tuple[Any, Any], bound: float) -> np.ndarray:
    """By how much figures differ beyond what they may; negative: not at all."""
    (mean, error), (peer, peer_error) = ours, theirs
    allowed = bound * np.maximum(peer, peer[DISC]) + LEVEL * np.hypot(error, peer_error)
    return abs(mean - peer) - allowed


@pytest.mark.parametrize(("row", "light"), COMPARED, ids=[f"{r.name}, {l}" for r, l in COMPARED])
def test_agrees_where_models_do(studio: ours_side.Studio, row: materials.Row, light: str) -> None:
    ours = measured(studio, row, light)
    wrong = []
    for peer, bound in bounds(row, light).items():
        theirs = stored(row, light, peer)
        for k in np.nonzero(excess(ours, theirs, bound) > 0)[0]:
            figure = f"{ours[0][k]:.4f} beside {theirs[0][k]:.4f}"
            wrong.append(f"{setting.wanted(light)[k]}: {figure} of {peer}")
    assert not wrong, wrong


def test_finds_errors_of_some_percent(studio: ours_side.Studio) -> None:
    row = next(r for r, _ in COMPARED if r.name == "metal 0.4")
    mean, error = measured(studio, row, "dome")
    theirs = stored(row, "dome", "cycles")
    assert (excess((mean * 1.04, error), theirs, bounds(row, "dome")["cycles"]) > 0).any()
