"""Sphinx: the pages of docs/ and the reference from docstrings. Built by scripts/docs."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "clients/python"))

import heliograph  # noqa: E402  (found by the line above)

project = "Heliograph"
author = copyright = "The Heliograph authors"
version = release = heliograph.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
exclude_patterns = ["gallery/**/README.md"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
# Pages link to sources of the repository (../examples/hello.py), which are no pages of the site.
suppress_warnings = ["myst.xref_missing", "misc.highlighting_failure"]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
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
    """Docstrings are plain text in paragraphs, not markup."""
    lines[:] = [as_text(line) for line in lines]


def setup(app):
    app.connect("autodoc-process-docstring", plain)
