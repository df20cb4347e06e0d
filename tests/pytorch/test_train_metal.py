"""The short form of examples/train_metal.py: both networks learn something from either picture."""

import importlib.util
import pathlib

import heliograph as hg
import pytest
import torch

PATH = pathlib.Path(__file__).resolve().parents[2] / "examples/train_metal.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("train_metal", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_pictures_of_a_draw_show_the_same_can(example):
    with hg.connect() as client, client.create_scene() as scene:
        example.build(scene)
        batch = next(iter(example.stream(scene, 16, 3, is_test=False)))
    for kind in example.KINDS:
        assert batch[kind].shape == (16, 3, example.SIZE, example.SIZE)
        assert 0 <= batch[kind].min() and batch[kind].max() < 1
    assert torch.allclose(batch["axis"].norm(dim=1), torch.ones(16), atol=1e-4)
    for i, (x0, y0, x1, y1) in enumerate(batch["box"].int().tolist()):
        differs = batch["path-traced"][i] != batch["flat-shaded"][i]  # metal, not the dome
        assert differs[:, y0:y1, x0:x1].float().mean() > 0.3


def test_both_are_trained_and_compared(example, capsys):
    torch.set_num_threads(1)
    results = example.main(256, 48)
    output = capsys.readouterr().out
    assert "learnt from" in output and "256 images to learn from, 48 tests" in output
    assert set(results) == set(example.KINDS)
    for found, overlap, angle in results.values():
        assert 0 <= found <= 1 and 0 < overlap < 1
        assert angle < 85  # 90 degrees is what guessing gives
