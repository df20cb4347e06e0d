"""The README's first program runs as it stands there."""

import pathlib
import re

import numpy as np

README = pathlib.Path(__file__).parents[2] / "README.md"


def test_the_first_program_runs(tmp_path, monkeypatch):
    (program,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(program, "README.md", "exec"), names)
    frame = names["frame"]
    assert frame["depth"].shape == (480, 640)
    box = frame.labels["bbox_visible"][0]
    rows, columns = np.nonzero(frame["instance"] == frame.labels["label"][0])
    assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    assert (tmp_path / "hello.png").stat().st_size > 10_000


def test_every_file_that_the_readme_names_is_there():
    links = re.findall(r"\]\(([^)#]+)\)", README.read_text())
    missing = [link for link in links if not (README.parent / link).exists()]
    assert links
    assert not missing
