"""The scenes DOME, MESH and FAT: what is promised of their images, their settings, and the command
that makes them, which is killed and run again."""

import json
import os
import signal
import subprocess
import sys
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from drawing import drawn, meeting, seen, vertices
from heliograph import cli

SMALL = {"width": 64, "height": 48}
WRONG = [
    *(("dome", "objects", value) for value in (0, 2.5, "many")),
    *(("dome", "distance", value) for value in ((1.0,), ("a", "b"), (2, 1), (-1, 1))),
    *(("dome", "distractors", value) for value in ((3,), (1.5, 2.5))),
    *(("dome", "domes", value) for value in ("folder", [1])),
    *(("dome", key, -1) for key in ("seed", "model_size", "box")),
    *(("mesh", key, 0) for key in ("shapes", "materials")),
    ("mesh", "domes", ["folder"]),  # it has none
    *(("fat", key, value) for key in ("floors", "visible") for value in (0, 5.5)),
]


def built(client, name, **settings):
    scene = client.create_scene()
    made = hd.make_scene(name, **SMALL, **settings)
    return scene, *made.build(scene)


def entities(scene, pattern):
    return [found for found in scene.find(pattern) if isinstance(found, hg.Entity)]


def test_dome_shows_goods_among_distractors(client):
    scene, camera, randomizer = built(client, "dome")
    wares = [scene[f"ware/{i}"] for i in range(12)]
    for index in range(3):
        draw = drawn(scene, camera, randomizer, index)
        with seen(scene, draw) as branch:
            shown = [e for e in (branch[f"distractor/{i}"] for i in range(25)) if e.visible]
            assert 5 <= len(shown) <= 25
            assert meeting(branch, wares) == 0 and meeting(branch, shown, wares) == 0
        frame = scene.render(camera, overlay=draw.edit, planes=["instance"], labels=True)
        assert (frame.labels["visibility"] > 0.1).sum() >= 4
        assert set(frame.categories.values()) == {"can", "carton", "bottle", "mug", "bowl", "ball"}
        assert len(frame.labels["label"]) == 12


def test_mesh_moves_before_lights_that_are_behind_the_camera(client):
    scene, camera, randomizer = built(client, "mesh", objects=150, shapes=12, materials=20)
    for index in range(2):
        draw = drawn(scene, camera, randomizer, index)
        with seen(scene, draw) as branch:
            lights = entities(branch, "random/light/*")
            assert 2 <= len(lights) <= 6
            assert all(light.world_transform[0, 3] < 0 for light in lights)  # it looks along +X
        planes = ["instance", "depth", "flow_backward", "flow_backward_valid"]
        frame = scene.render(camera, overlay=draw.edit, planes=planes)
        hit = frame["instance"] > 0
        assert 0.1 < hit.mean() < 0.95
        assert frame["flow_backward_valid"].all()
        flow = np.linalg.norm(frame["flow_backward"], axis=2)
        assert flow[hit].mean() > 0.1 and np.abs(flow[~hit]).max() == 0
        assert frame["depth"][hit].min() > 1.0 and frame["depth"][hit].max() < 13
        assert len(np.unique(frame["instance"])) > 40


def test_fat_drops_goods_onto_a_floor_and_looks_at_them(client):
    pytest.importorskip("pybullet")
    scene, camera, randomizer = built(client, "fat", floors=6)
    wares = [scene[f"ware/{i}"] for i in range(12)]
    floors = set()
    for index in range(3):
        draw = drawn(scene, camera, randomizer, index)
        assert min(vertices(draw, ware)[:, 2].min() for ware in wares) > -2e-3
        with seen(scene, draw) as branch:
            floors.add(branch["floor"].materials[0]._read("material")[0].SerializeToString())
        frame = scene.render(camera, overlay=draw.edit, planes=[], labels=["amodal"])
        assert (frame.labels["visibility"] >= 0.1).sum() >= 4
    assert len(floors) == 3


def test_models_of_the_user_take_the_place_of_the_goods(client):
    bolt = os.path.join(os.path.dirname(__file__), "../../examples/assets/bolt/bolt.glb")
    scene, camera, randomizer = built(client, "dome", models=[bolt], objects=3, model_size=0.1)
    draw = drawn(scene, camera, randomizer)
    assert scene.categories == {1: "bolt"}
    bolts = entities(scene, "bolt*")[:3]
    for bolt in bolts:
        assert 0.05 < np.ptp(vertices(draw, bolt), axis=0).max() <= 0.12


def test_settings_come_from_a_file_and_say_what_they_refuse(tmp_path, capsys):
    assert cli.main(["dataset", "mesh", "--print-config"]) == 0
    text = capsys.readouterr().out
    assert "objects = 1000\n" in text and "speed = [0.0, 1.5]\n" in text
    path = tmp_path / "mesh.toml"
    path.write_text(text.replace("objects = 1000", "objects = 7"))
    assert cli.main(["dataset", "mesh", "--print-config", "--config", str(path)]) == 0
    assert capsys.readouterr().out == path.read_text()
    path.write_text('models = ["a.glb"]\ncolour = 3\n')
    assert cli.main(["dataset", "mesh", "--config", str(path), "--out", "x"]) == 2
    assert "mesh has no such setting" in capsys.readouterr().err
    with pytest.raises(hg.InvalidArgument, match="speed: needs a value like"):
        hd.make_scene("mesh", speed=3)
    for name, key, value in WRONG:
        with pytest.raises(hg.InvalidArgument, match=f"^{key}: ") as refused:
            hd.make_scene(name, **{key: value})
        assert refused.value.field == key
    path.write_bytes(b"\xff\xfe")
    assert cli.main(["dataset", "mesh", "--config", str(path), "--out", "x"]) == 2
    assert f"{path}: " in capsys.readouterr().err
    path.write_text('models = "a.glb"')
    assert cli.main(["dataset", "mesh", "--config", str(path), "--out", "x"]) == 2
    assert "models: needs a list of files, not 'a.glb'" in capsys.readouterr().err
    with pytest.raises(hg.InvalidArgument, match="one of dome, mesh, fat"):
        hd.make_scene("moon")
    assert cli.main(["dataset", "fat", "--out", str(tmp_path), "--labels-only"]) == 2
    assert cli.main(["dataset", "fat"]) == 2


def files(root):
    kept = {path: path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}
    return {str(p.relative_to(root)): b for p, b in kept.items() if "partial" not in p.parts}


def test_a_killed_command_goes_on_where_it_was_to_the_same_bytes(tmp_path):
    pytest.importorskip("pybullet")
    command = [
        *(sys.executable, "-m", "heliograph", "dataset", "fat", "--count", "4", "--spp", "1"),
        *("--size", "64x48", "--config", str(tmp_path / "fat.toml"), "--out"),
    ]
    (tmp_path / "fat.toml").write_text("objects = 4\nfloors = 2\n")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, str(whole)], check=True, capture_output=True)
    victim = subprocess.Popen(
        [*command, str(killed)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    end = time.monotonic() + 60
    while not list(killed.glob(".heliograph/records/*.json")) and time.monotonic() < end:
        time.sleep(0.01)
    victim.send_signal(signal.SIGKILL)
    victim.wait()
    done = subprocess.run([*command, str(killed)], check=True, capture_output=True, text=True)
    assert "images made" in done.stdout
    assert hd.validate(killed).ok
    a, b = files(whole), files(killed)
    for name in a:
        if name.startswith(("images", "annotations")):
            assert a[name] == b[name], name
    assert a.keys() == b.keys()


@pytest.mark.parametrize(
    "options", [["exr"], ["exr", "--labels-only"], ["parquet", "--labels-only"]]
)
def test_all_labels_and_labels_alone(tmp_path, options):
    config = tmp_path / "small.toml"
    config.write_text("objects = 30\nshapes = 6\nmaterials = 6\n")
    command = ["dataset", "mesh", "--count", "2", "--spp", "1", "--size", "64x48"]
    command += ["--out", str(tmp_path / "out"), "--format", *options]
    command += ["--config", str(config)]
    assert cli.main(command) == 0
    assert bool(list(tmp_path.glob("out/images/*.png"))) == ("--labels-only" not in options)
    expected = "exr/*.exr" if options[0] == "exr" else "instances.parquet"
    assert list(tmp_path.glob(f"out/{expected}"))
    made = json.loads((tmp_path / "out" / ".heliograph" / "dataset.json").read_text())
    assert made["options"] == {"roulette_depth": 1, "spp": 1}
