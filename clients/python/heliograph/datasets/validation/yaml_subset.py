"""data.yaml of YOLO, in the part of YAML that such files use. Used by yolo.py.

Format: YAML 1.2.2: a mapping whose values are scalars, lists, or mappings and lists of scalars.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .report import Malformed


def read_yaml(path: Path) -> dict[str, Any]:
    """The top-level mapping. Block scalars (`download: |`) come as None."""
    out: dict[str, Any] = {}
    key = ""
    for number, line in enumerate(path.read_text().splitlines(), 1):
        text = _uncommented(line)
        if not text.strip() or text.startswith("---"):
            continue
        inner = text.strip()
        if not text[0].isspace() and not inner.startswith("- "):
            key, colon, value = inner.partition(":")
            if not colon:
                raise Malformed(path, f"line {number} is no `name: value`: {inner[:60]!r}")
            key = str(_scalar(key))
            out[key] = _scalar(value)
        elif inner.startswith("- "):
            if not isinstance(out.get(key), list):
                out[key] = []
            out[key].append(_scalar(inner[2:]))
        else:
            name, colon, value = inner.partition(":")
            if colon and out.get(key) is None:
                out[key] = {}
            if colon and isinstance(out[key], dict):
                out[key][str(_scalar(name))] = _scalar(value)
    return out


def _uncommented(line: str) -> str:
    """Without what follows a # that is not within quotes."""
    quote = ""
    for i, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "#" and (i == 0 or line[i - 1].isspace()):
            return line[:i].rstrip()
    return line.rstrip()


def _scalar(text: str) -> Any:
    text = text.strip()
    if text in ("", "~", "null", "|", ">", "|-", ">-"):
        return None
    if text.startswith("[") and text.endswith("]"):
        return [_scalar(part) for part in text[1:-1].split(",") if part.strip()]
    if text.startswith("{") and text.endswith("}"):
        pairs = (part.partition(":") for part in text[1:-1].split(",") if part.strip())
        return {str(_scalar(name)): _scalar(value) for name, _, value in pairs}
    if text[0] == "'" and text[-1] == "'":
        return text[1:-1].replace("''", "'")
    try:
        return json.loads(text)
    except ValueError:
        return text
