"""The scripts examples/nvisii_*.py run as their users run them."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"


def run(name, folder, *arguments):
    command = [sys.executable, str(EXAMPLES / f"nvisii_{name}.py"), *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    return done.stdout


def picture(path):
    return np.asarray(Image.open(path)).astype(float)


def test_materials(tmp_path):
    run("materials", tmp_path, "--width", 96, "--height", 54, "--spp", 4)
    image = picture(tmp_path / "nvisii_materials.png")
    assert image.shape == (54, 96, 4) and image[..., :3].std() > 15


def test_dataset(tmp_path):
    pytest.importorskip("OpenEXR")
    run("dataset", tmp_path, "--frames", 2, "--size", 96, "--spp", 2)
    for frame in ("00000", "00001"):
        stem = tmp_path / "nvisii_dataset" / frame
        found = json.loads(stem.with_suffix(".json").read_text())
        whole = 0
        for thing in found["objects"]:
            if thing["pixels"] < 40 or thing["name"].startswith("cone"):
                continue
            x0, y0, x1, y1 = thing["bounding_box"]
            x, y = thing["center_image"]
            whole += x0 < x < x1 and y0 < y < y1
        assert whole >= 3
        assert len(np.unique(picture(stem.with_suffix(".seg.png")))) > 5
        assert stem.with_suffix(".depth.exr").stat().st_size > 1000


def test_motion(tmp_path):
    run("motion", tmp_path, "--width", 96, "--height", 54, "--spp", 8)
    folder = tmp_path / "nvisii_motion"
    blurred, sharp = picture(folder / "blurred.png"), picture(folder / "sharp.png")
    moving = np.abs(np.load(folder / "motion.npy")).sum(axis=-1) > 0.5
    assert 0.02 < moving.mean() < 0.2
    assert np.abs(blurred - sharp)[moving].mean() > 2 * np.abs(blurred - sharp)[~moving].mean()


def test_physics(tmp_path):
    pytest.importorskip("pybullet")
    out = run("physics", tmp_path, "--objects", 8, "--steps", 300, "--size", 64, "--spp", 2)
    assert "8 of 8 lie" in out
    assert picture(tmp_path / "nvisii_physics.png").shape == (64, 64, 4)


def test_volume(tmp_path):
    run("volume", tmp_path, "--size", 64, "--spp", 4, "--voxels", 24)
    assert picture(tmp_path / "nvisii_volume.png")[..., :3].std() > 10
