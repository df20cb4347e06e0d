"""The command line and the examples, as a user runs them."""

import subprocess
import sys
from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
HELMET = ROOT / "examples/assets/FlightHelmet/FlightHelmet.gltf"


def heliograph(*arguments):
    command = [sys.executable, "-m", "heliograph", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_render_to_pictures(tmp_path):
    out = tmp_path / "out.png"
    run = heliograph(
        *("render", HELMET, "-o", out, "--size", "240x135", "--spp", "16"),
        *("--planes", "depth,normal,instance"),
    )
    assert run.returncode == 0, run.stderr
    for name in ("out.png", "out.depth.png", "out.normal.png", "out.instance.png"):
        assert Image.open(tmp_path / name).size == (240, 135)
    picture = np.asarray(Image.open(out)).astype(float)
    assert 40 < picture.mean() < 215 and picture.std() > 15
    seen = np.asarray(Image.open(tmp_path / "out.instance.png")).any(axis=2)
    ys, xs = np.nonzero(seen)
    assert 0 < xs.min() and xs.max() < 239 and 0 < ys.min() and ys.max() < 134
    assert max(np.ptp(xs) / 240, np.ptp(ys) / 135) > 0.6


def test_render_to_exr_and_again(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    out = tmp_path / "out.exr"
    run = heliograph("render", HELMET, "-o", out, "--size", "64x64", "--spp", "4", "--planes=depth")
    assert run.returncode == 0, run.stderr
    with OpenEXR.File(str(out)) as file:
        assert [part.name() for part in file.parts] == ["beauty", "depth"]
        assert "heliograph.manifest" in file.parts[0].header["manifest"]
        assert file.parts[1].header["unit"] == "m"


def test_refusals_have_the_right_exit_status(tmp_path):
    missing = heliograph("render", tmp_path / "no.glb", "-o", tmp_path / "a.png")
    assert missing.returncode == 2 and "no.glb" in missing.stderr
    (tmp_path / "bad.glb").write_bytes(b"glTF nonsense")
    bad = heliograph("render", tmp_path / "bad.glb", "-o", tmp_path / "a.png")
    assert bad.returncode == 2 and "bad.glb" in bad.stderr
    assert "Traceback" not in bad.stderr + missing.stderr
    assert heliograph("serve", "--no-such-flag").returncode == 64


def test_the_training_loop_says_what_it_lacks():
    script = ROOT / "examples/train_on_gpu.py"
    run = subprocess.run([sys.executable, script, "2"], capture_output=True, text=True, timeout=300)
    if run.returncode == 0:  # here are PyTorch, a GPU and a daemon for it
        assert "step 1: error of 1 / depth" in run.stdout
    else:
        assert run.returncode == 77 and run.stderr.startswith("SKIPPED: this needs"), run.stderr


def test_info():
    run = heliograph("info")
    assert run.returncode == 0 and "limits" in run.stdout, run.stderr


def test_a_reader_that_has_seen_enough_is_no_error():
    command = f"'{sys.executable}' -m heliograph info | true"
    run = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60)
    assert run.stderr == ""


def test_info_tells_who_uses_what(client):
    with client.create_scene("farm", lifetime="daemon"), client.create_scene():
        run = heliograph("info", "--address", client.address)
        assert run.returncode == 0, run.stderr
        lines = [line.split() for line in run.stdout.splitlines()]
        mine = [line for line in lines if line[:1] == ["python"]]
        assert [line[-1] for line in mine] == ["1", "0"]  # private scenes; the command has none
        assert ["farm", "daemon,", "revision", "0"] in lines
        assert any(line[:1] == ["tenant_bytes"] and len(line) == 3 for line in lines)
        assert str(client.connection.link.session) not in run.stdout


EXAMPLES = ["hello", "randomize", "labels", "import_model", "worlds", "robot"]


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples(name, tmp_path):
    command = [sys.executable, str(ROOT / f"examples/{name}.py"), str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert list(tmp_path.glob("*.png"))


def test_export_a_model_and_a_scene_file(tmp_path):
    fox = ROOT / "tests/assets/gltf/Fox.glb"
    run = heliograph("export", fox, "-o", tmp_path / "fox.glb", "--animation", "Run")
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "fox.glb").read_bytes()[:4] == b"glTF"
    run = heliograph("export", tmp_path / "fox.glb", "-o", tmp_path / "fox.obj")
    assert run.returncode == 2 and "neither in .glb nor in .usdz" in run.stderr
    with hg.connect() as client, client.create_scene("lamp") as scene:
        with scene.edit() as edit:
            edit.dome(color=1.0)
            edit.entity("ball", mesh=edit.mesh("m", **hg.shapes.sphere()))
        scene.save(tmp_path / "scene.helio")
    run = heliograph("export", tmp_path / "scene.helio", "-o", tmp_path / "ball.glb")
    assert run.returncode == 0 and "dome: glTF has none: it is left out" in run.stderr
    assert b'"ball"' in (tmp_path / "ball.glb").read_bytes()
    run = heliograph("export", "--scene", "lamp", "-o", tmp_path / "ball.glb")
    assert run.returncode == 2 and "--address" in run.stderr
