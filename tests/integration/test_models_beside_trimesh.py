"""Models beside trimesh: those that it writes, and those of tests/assets, by bench/models.py."""

import json
import pathlib
import subprocess
import sys

import pytest
import trimesh

ROOT = pathlib.Path(__file__).parents[2]
ASSETS = ROOT / "tests/assets"
sys.path.append(str(ROOT / "bench"))
import models  # noqa: E402

SHAPES = {
    "box": trimesh.creation.box((1, 2, 3)),
    "ball": trimesh.creation.icosphere(2, 0.3),
    "rod": trimesh.creation.cylinder(0.1, 4),
    "capsule": trimesh.creation.capsule(2, 0.5),
    "ring": trimesh.creation.annulus(0.5, 1, 0.2),
}
WRITERS = {
    "glb": {},
    "obj": {},
    "ply": {},
    "ascii.ply": {"encoding": "ascii"},
    "stl": {},
    "ascii.stl": {"file_type": "stl_ascii"},
    "off": {},
}


def compare(*places, explained=True):
    """Exit status, lines and counts of the command."""
    command = [sys.executable, str(ROOT / "bench/models.py"), "--trimesh", sys.executable]
    if explained:
        command += ["--explained", str(ROOT / "bench/models_explained.txt")]
    done = subprocess.run([*command, *map(str, places)], capture_output=True, text=True)
    assert done.stdout, done.stderr
    *lines, counts = done.stdout.splitlines()
    return done.returncode, lines, json.loads(counts)


def test_what_trimesh_writes_loads_as_it_has_it(tmp_path):
    for name, shape in SHAPES.items():
        shape.apply_translation((0.3, -0.2, 0.1))
        for ending, options in WRITERS.items():
            shape.export(tmp_path / f"{name}.{ending}", **options)
    status, lines, counts = compare(tmp_path)
    assert (status, lines) == (0, [])
    assert counts == {"files": 35, "refused by us": 0, "as trimesh": 35}


def test_our_files_load_as_trimesh_has_them_or_for_a_reason():
    status, lines, counts = compare(ASSETS / "gltf", ASSETS / "mesh")
    assert status == 0, lines
    assert counts["files"] == 27 and counts["refused by us"] == 1
    assert counts["as trimesh"] >= 13


def test_a_difference_without_a_reason_is_told():
    path = ASSETS / "gltf/simple-instancing.glb"  # trimesh does not read its instances
    status, lines, _ = compare(path, explained=False)
    assert status == 1
    assert any(line.startswith(f"{path}: trimesh: triangles: 1500 / 12") for line in lines)


FACTS = {
    "triangles": 12,
    "area": 6.0,
    "bounds": [[0, 0, 0], [1, 1, 1]],
    "textures": [[0.5, 0.5, 0.5]],
    "joints": 2,
    "animations": 1,
    "cameras": 1,
    "lights": 0,
}


def test_equal_facts_do_not_differ():
    close = {**FACTS, "area": 6.0003, "bounds": [[0, 0, 5e-5], [1, 1, 1]], "cameras": None}
    assert list(models.compared(FACTS, close)) == []


@pytest.mark.parametrize(
    ("what", "value"),
    [
        ("triangles", 11),
        ("joints", 0),
        ("animations", 0),
        ("cameras", 0),
        ("lights", 1),
        ("area", 6.001),
        ("bounds", [[0, 0, 2e-4], [1, 1, 1]]),
        ("bounds", None),
        ("textures", [[0.5, 0.5, 0.52]]),
    ],
)
def test_each_fact_that_differs_is_named(what, value):
    found = list(models.compared(FACTS, {**FACTS, what: value}))
    assert [name for name, _ in found] == [what]


def test_a_file_that_one_alone_loads_differs():
    (found,) = models.compared(FACTS, {"refusal": "no"})
    assert found == ("loads", "loads / no")
    assert list(models.compared({"refusal": "a"}, {"refusal": "b"})) == []


def test_a_reader_that_ends_or_hangs_refuses_its_file(tmp_path, monkeypatch):
    programs = {"ends": "import sys; input(); sys.exit(3)", "hangs": "import time; time.sleep(60)"}
    monkeypatch.setattr(models, "READERS", tmp_path)
    for name, text in programs.items():
        (tmp_path / f"{name}_reader.py").write_text(text)
    assert models.Reader("ends", sys.executable, 30).read("a") == {"refusal": "ended by 3"}
    assert models.Reader("hangs", sys.executable, 0.5).read("a") == {"refusal": "took 0.5 s"}
