"""Every golden scene agrees with its golden image under other numbers; a wrong one does not."""

from __future__ import annotations

import golden
import heliograph as hg
import pytest
import scenes

SPP = 64


@pytest.fixture(scope="module")
def client():
    with hg.connect() as connected:
        yield connected


@pytest.mark.parametrize("name", scenes.SCENES)
def test_agrees_with_golden(client: hg.Client, name: str) -> None:
    image, variance = scenes.render(client, name, SPP, seed=1234)
    verdict = golden.compare(image, variance, golden.load(name))
    assert verdict.ok, verdict


def test_finds_faint_and_local_errors(client: hg.Client) -> None:
    image, variance = scenes.render(client, "cornell", SPP, seed=5)
    truth = golden.load("cornell")
    assert golden.compare(image * 1.02, variance, truth).mean_p < golden.LEVEL
    image[10:14, 20:24] *= 2
    assert golden.compare(image, variance, truth).passing < golden.PASSING
