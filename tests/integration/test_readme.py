"""The README's programs run as they stand there."""

import json
import os
import pathlib
import re
import shutil

import heliograph.datasets as hd
import numpy as np

README = pathlib.Path(__file__).parents[2] / "README.md"


def programs():
    return re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)


def test_the_first_program_runs(tmp_path, monkeypatch):
    program, _ = programs()
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(program, "README.md", "exec"), names)
    frame = names["frame"]
    assert frame["depth"].shape == (480, 640)
    box = frame.labels["bbox_visible"][0]
    rows, columns = np.nonzero(frame["instance"] == frame.labels["label"][0])
    assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    assert (tmp_path / "hello.png").stat().st_size > 10_000


def test_ten_lines_make_a_valid_data_set(tmp_path, monkeypatch):
    """Whole with HELIOGRAPH_LONG=1, else the same text with fewer and smaller images."""
    _, program = programs()
    assert len(program.splitlines()) <= 10
    shutil.copy(README.parent / "examples/assets/bolt/bolt.glb", tmp_path)
    monkeypatch.chdir(tmp_path)
    small = {} if os.environ.get("HELIOGRAPH_LONG") else {"count": 3, "spp": 2, "size": (160, 120)}
    generate = hd.generate
    monkeypatch.setattr(hd, "generate", lambda *a, **options: generate(*a, **{**options, **small}))
    exec(compile(program, "README.md", "exec"), {})
    assert len(list((tmp_path / "out/images").iterdir())) == small.get("count", 100)
    annotations = json.loads((tmp_path / "out/annotations/instances.json").read_text())
    assert len(annotations["annotations"]) >= 12
    assert {c["name"] for c in annotations["categories"]} == {"bolt"}


def test_every_file_that_the_readme_names_is_there():
    links = re.findall(r"\]\(([^)#]+)\)", README.read_text())
    missing = [link for link in links if not (README.parent / link).exists()]
    assert links
    assert not missing
