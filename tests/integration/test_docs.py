"""Contents of the documentation hold: programs run, commands parse, C++ compiles, links lead on."""

import argparse
import inspect
import os
import re
import subprocess
import sys

import heliograph as hg
import heliograph.datasets as hd
import pages
import pytest
from heliograph._wire import launch
from heliograph.cli import make_parser

WITH_PYTHON = [
    pytest.param(page, id=page.stem)
    for page in pages.PAGES
    if page.name != "README.md"  # test_readme.py runs that
    and any(block.language == "python" for block in pages.blocks_of(page))
]
SMALL = {"count": 2, "size": (96, 72)}
SPP = 2


@pytest.fixture
def quick(monkeypatch):
    """Fewer samples, images and worlds than the pages ask for, unless HELIOGRAPH_LONG=1."""
    if os.environ.get("HELIOGRAPH_LONG"):
        return
    render, generate = hg.Scene.render, hd.generate

    def capped(options):
        return {**options, "spp": min(SPP, options.get("spp", SPP))}

    monkeypatch.setattr(hg.Scene, "render", lambda *a, **o: render(*a, **capped(o)))
    monkeypatch.setattr(hd, "generate", lambda *a, **o: generate(*a, **{**capped(o), **SMALL}))


@pytest.mark.parametrize("page", WITH_PYTHON)
def test_the_programs_of_a_page_run(page, client, quick, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(hg.Picture, "show", lambda self: None)  # it needs a screen
    monkeypatch.setattr(hg.Viewer, "wait", lambda self: None)  # for Ctrl-C
    program = pages.Program(page, client)
    for block in pages.blocks_of(page):
        if block.language in ("python", "setup") and block.not_run is None:
            program.run(block)


def subcommands():
    [choices] = [
        action.choices
        for action in make_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    ]
    return choices


def flags_of_the_daemon():
    command = [launch.find_program(), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(re.findall(r"--[a-z][a-z0-9-]*", done.stdout))


def test_commands_are_those_of_the_command_line():
    known, seen, daemon = subcommands(), set(), flags_of_the_daemon()
    for page in pages.PAGES:
        lines, quoted = pages.commands_of(page, "heliograph")
        for words in lines:
            make_parser().parse_args(words)  # exits with what is wrong
        for words in [*lines, *quoted]:
            name = words[0]
            flags = {word.partition("=")[0] for word in words if word.startswith("--")}
            assert name in known or name.startswith("--"), f"{page.name}: heliograph {words}"
            if name in known:
                have = daemon if name == "serve" else known[name]._option_string_actions
                assert flags <= set(have), f"{page.name}: heliograph {words}"
                seen.add(name)
    assert seen == set(known), "a command that no page shows"


def test_flags_are_those_of_the_daemon():
    have, seen = flags_of_the_daemon(), 0
    for page in pages.PAGES:
        lines, quoted = pages.commands_of(page, "heliographd")
        for words in [*lines, *quoted]:
            flags = {word.partition("=")[0] for word in words if word.startswith("--")}
            assert flags <= have, f"{page.name}: heliographd {words}"
            seen += len(flags)
    assert seen > 10


def test_each_promise_stands_in_the_manual_with_its_command():
    """Every program of tests/fault but their common parts, and none that is not there."""
    manual = (pages.DOCS / "operations.md").read_text()
    listed = set(re.findall(r"^\| `\.venv/bin/python tests/fault/(\w+)\.py", manual, re.MULTILINE))
    programs = [path for path in (pages.ROOT / "tests/fault").glob("*.py") if path.stem != "common"]
    assert listed == {path.stem for path in programs if "Report(" in path.read_text()}


def test_settings_are_those_of_the_daemon():
    toml = pytest.importorskip("tomllib" if sys.version_info >= (3, 11) else "tomli")
    blocks = [b for page in pages.PAGES for b in pages.blocks_of(page) if b.language == "toml"]
    assert blocks
    for block in blocks:
        settings = toml.loads(block.code)
        settings.pop("limits", None)
        assert {f"--{name}" for name in settings} <= flags_of_the_daemon()


def test_the_blocks_of_the_cpp_client_compile(tmp_path):
    """As one function: setups and blocks in the order of the page, includes before it."""
    blocks = [b for b in pages.blocks_of(pages.DOCS / "cpp.md") if b.language in ("cpp", "setup")]
    assert len([b for b in blocks if b.language == "cpp"]) >= 4
    lines = [line for block in blocks for line in block.code.splitlines()]
    includes = [line for line in lines if line.startswith("#include")]
    body = [line for line in lines if not line.startswith("#include")]
    source = tmp_path / "page.cpp"
    source.write_text("\n".join([*includes, "void page() {", *body, "}", ""]))
    headers = f"-I{pages.ROOT / 'clients/cpp'}"
    command = ["g++", "-std=c++17", "-fsyntax-only", "-Wall", "-Werror", "-Wno-unused", headers]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_links_lead_to_files_and_headings():
    for page in pages.PAGES:
        for link in re.findall(r"\]\((?!https?://)([^)\s]+)\)", page.read_text()):
            name, _, heading = link.partition("#")
            target = page.parent / name if name else page
            assert target.exists(), f"{page.name}: {link}"
            if heading:
                assert heading in headings(target), f"{page.name}: {link}"


def headings(page):
    """The anchors of a page, as GitHub and the site make them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_pages_say_why_they_do_not_run():
    for page in pages.PAGES:
        for block in pages.blocks_of(page):
            assert block.not_run is None or len(block.not_run.split()) >= 3


def test_the_site_builds_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    done = subprocess.run(
        [*command, str(pages.DOCS), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    reference = {page.stem: page.read_text() for page in (tmp_path / "reference").glob("*.html")}
    every = "".join(reference.values())
    for module in (hg, hd):
        names = {name for name in module.__all__ if f'id="{module.__name__}.{name}"' not in every}
        errors = {name for name in names if f'id="heliograph.errors.{name}"' in every}
        modules = {name for name in names if inspect.ismodule(getattr(module, name))}
        assert names <= errors | modules, module.__name__
    assert 'id="heliograph.Scene.render"' in reference["client"]
    assert all(f"usage: heliograph {name}" in reference["command"] for name in subcommands())
    assert "f32[1] metres along the optical axis" in reference["contract"]
    protos = (pages.ROOT / "proto/heliograph/v1").glob("*.proto")
    shown = (pages.DOCS / "reference/contract.md").read_text()
    assert all(f"/{proto.name}\n" in shown for proto in protos)
