"""Sphinx: the pages of docs/ and the reference from docstrings. Built by scripts/docs."""

import inspect
import pathlib
import re
import sys

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.util.inspect import stringify_signature

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "clients/python"), str(ROOT / "clients/nvisii")]

import heliograph  # noqa: E402  (found by the line above)
from heliograph.cli import make_parser  # noqa: E402

project = "Heliograph"
author = copyright = "The Heliograph authors"
version = release = heliograph.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["gallery/**/README.md"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
# Pages link to sources of the repository (../examples/hello.py), which are no pages of the site.
suppress_warnings = ["myst.xref_missing", "misc.highlighting_failure"]
# A signature that says Scene may mean that of asyncio, too; the link leads to heliograph.Scene.
suppress_warnings += ["ref.python"]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
autodoc_mock_imports = ["torch"]  # heliograph.torch alone imports it
smartquotes = False
html_theme = "furo"
html_title = f"Heliograph {version}"


LITERAL = re.compile(r"`([^`]+)`")


def as_text(line):
    """A line of plain text in reStructuredText; `code` stays code."""
    parts = LITERAL.split(line.strip())
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"([\\*`|_])", r"\\\1", parts[i])
    return "".join(f"``{part}``\\ " if i % 2 else part for i, part in enumerate(parts)).rstrip(
        "\\ "
    )


def plain(app, what, name, obj, options, lines):
    """Docstrings are plain text in paragraphs, and programs that are indented by four."""
    found, program = [], False
    for line in lines:
        if line.startswith("    ") and not program:
            found += ["", "::", ""]
        program = line.startswith("    ") or (program and not line)
        found.append(line if program else as_text(line))
    lines[:] = found


def signature(app, what, name, obj, options, arguments, result):
    """Of a class its __init__'s, whatever is mocked beneath it; of an error none but its own."""
    if not isinstance(obj, type):
        return arguments, result
    if inspect.isfunction(vars(obj).get("__init__")):
        given = inspect.signature(obj.__init__)
        own = list(given.parameters.values())[1:]
        given = given.replace(parameters=own, return_annotation=given.empty)
        return stringify_signature(given), None
    return ("" if issubclass(obj, Exception) else arguments), None


class Commands(Directive):
    """The help of each subcommand of heliograph, a section each."""

    def run(self):
        return [section_of(name, parser) for name, parser in subcommands(make_parser())]


def subcommands(parser):
    [action] = [a for a in parser._actions if isinstance(a.choices, dict)]
    return action.choices.items()


def section_of(name, parser):
    section = nodes.section(ids=[name])
    section += nodes.title(text=f"heliograph {name}")
    section += nodes.literal_block(text=parser.format_help(), language="text")
    return section


def setup(app):
    app.add_directive("heliograph-commands", Commands)
    app.connect("autodoc-process-docstring", plain)
    app.connect("autodoc-process-signature", signature)
