"""Programs in docs/ marked `<!-- runnable -->` run as they stand there; the site builds."""

import pathlib
import re
import subprocess
import sys

import pytest

DOCS = pathlib.Path(__file__).parents[2] / "docs"
RUNNABLE = re.compile(r"<!-- runnable -->\n```python\n(.*?)```", re.DOTALL)
PROGRAMS = [
    pytest.param(program, id=f"{page.stem}-{i}")
    for page in sorted(DOCS.glob("*.md"))
    for i, program in enumerate(RUNNABLE.findall(page.read_text()))
]


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_runs(program, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "docs", "exec"), {})
    assert any(path.stat().st_size > 1000 for path in tmp_path.iterdir())


def test_there_are_programs():
    marks = sum(page.read_text().count("<!-- runnable -->") for page in DOCS.glob("*.md"))
    assert marks == len(PROGRAMS) > 0


def test_the_site_builds_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [*command, str(DOCS), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    reference = (tmp_path / "reference.html").read_text()
    assert "heliograph.scene.Scene.render" in reference
    assert "f32[1] metres along the optical axis" in (tmp_path / "contract.html").read_text()
