"""Contents of the documentation's pages: programs, commands, C++.

A page's ```python blocks are one program: they run in the order of the page, with one set of names.
`<!-- setup` ... `-->` is such a block that readers do not see. `<!-- not run: REASON -->` before a
block leaves it out.
"""

from __future__ import annotations

import ast
import dataclasses
import pathlib
import re
import shlex
from typing import Any

import heliograph as hg
import heliograph.datasets as hd
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PACKAGES = [ROOT / f"clients/{name}/README.md" for name in ("python", "nvisii")]
PAGES = [ROOT / "README.md", *PACKAGES, *sorted(DOCS.rglob("*.md"))]

_BLOCK = re.compile(
    r"^(?:<!-- setup\n(?P<setup>.*?)^-->"
    r"|(?:<!-- not run: (?P<reason>[^\n]+) -->\n)?```(?P<language>\w+)\n(?P<code>.*?)^```)$",
    re.MULTILINE | re.DOTALL,
)
_SHAPE = re.compile(r"#\s*\(([\w, ]+)\)(?:\s+(bool|u?int\d+|float\d+))?")


@dataclasses.dataclass
class Block:
    """language: "setup" for what readers do not see. line: of the page, where `code` begins."""

    language: str
    code: str
    line: int
    not_run: str | None


def blocks_of(page: pathlib.Path) -> list[Block]:
    """The fenced blocks that name a language, and the setups, in the order of the page."""
    text = page.read_text()
    found = []
    for match in _BLOCK.finditer(text):
        part = "setup" if match["language"] is None else "code"
        line = text.count("\n", 0, match.start(part)) + 1
        found.append(Block(match["language"] or "setup", match[part], line, match["reason"]))
    return found


class Program:
    """The Python of a page. Its blocks find hg, hd, np, ROOT, and a `client` with an empty `scene`.

    A setup begins with another empty scene. `edit` is a new transaction of the scene before each
    block, and sent after it.
    """

    def __init__(self, page: pathlib.Path, client: hg.Client) -> None:
        self.page = page
        self.client = client
        self.names: dict[str, Any] = {"hg": hg, "hd": hd, "np": np, "ROOT": ROOT}
        self._begin()

    def _begin(self) -> None:
        self.names.update(client=self.client, scene=self.client.create_scene())

    def run(self, block: Block) -> None:
        if block.language == "setup":
            self._begin()
        edit = self.names["edit"] = self.names["scene"].edit()
        code = "\n" * (block.line - 1) + block.code
        exec(compile(code, str(self.page), "exec"), self.names)
        if self.names["edit"] is edit:
            edit.commit()
        self._check_shapes(block)

    def _check_shapes(self, block: Block) -> None:
        """`frame["depth"]  # (480, 640) float32` is checked; a letter is any length."""
        lines = block.code.splitlines()
        for statement in ast.parse(block.code).body:
            stated = _SHAPE.search(lines[statement.end_lineno - 1])
            if not (isinstance(statement, ast.Expr) and stated):
                continue
            source = ast.unparse(statement)
            array = eval(source, self.names)
            lengths = [word.strip() for word in stated[1].split(",") if word.strip()]
            where = f"{self.page.name}:{block.line + statement.lineno - 1}: {source}"
            assert len(array.shape) == len(lengths), f"{where} has the shape {array.shape}"
            for length, word in zip(array.shape, lengths, strict=True):
                assert word.isalpha() or int(word) == length, f"{where}: {array.shape}"
            assert stated[2] in (None, str(array.dtype)), f"{where} is of {array.dtype}"


def commands_of(page: pathlib.Path, program: str) -> tuple[list[list[str]], list[list[str]]]:
    """The words after `program`: of its lines in code, fenced or indented, and within sentences."""
    text = re.sub(r"\\\n\s*", " ", page.read_text())
    fenced = re.findall(r"^```\w*\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in fenced for line in block.splitlines()]
    lines += [line for line in text.splitlines() if line.startswith("    ")]
    quoted = re.findall(r"(?<!`)`([^`]+)`(?!`)", text)
    return _words_after(program, lines), _words_after(program, quoted)


def _words_after(program: str, lines: list[str]) -> list[list[str]]:
    found = []
    for line in lines:
        first, *words = line.split(maxsplit=1) or [""]
        if first.rpartition("/")[2] == program and words:
            found.append(shlex.split(words[0], comments=True))
    return found
