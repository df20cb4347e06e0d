"""Reading files as a stranger would: listings, JSON, YAML, pictures. Used by formats' modules."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..._wire.arrays import NdArray
from .report import Faults, Malformed

OWN = ".heliograph"  # records of generate(); no format's files
PICTURES = (".png", ".jpg", ".jpeg")
_CHUNK = 1 << 20


def files(root: Path, *endings: str) -> Iterator[Path]:
    """The files below a directory with one of these endings, sorted within each folder."""
    if not root.is_dir():
        return
    for path in sorted(root.iterdir()):
        if path.is_dir():
            if path.name != OWN:
                yield from files(path, *endings)
        elif path.suffix.lower() in endings:
            yield path


def any_file(root: Path, *endings: str) -> bool:
    """Is there one?"""
    return next(files(root, *endings), None) is not None


def batches(rows: Iterable[Any], size: int) -> Iterator[list[Any]]:
    """Lists of `size` rows, the last one shorter."""
    iterator = iter(rows)
    while batch := list(islice(iterator, size)):
        yield batch


# ------------------------------------------------------------ JSON


def read_json(path: Path) -> Any:
    """Content of a JSON file. Malformed."""
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError:
        raise Malformed(path, "is not there, and the format needs it: write it") from None
    except ValueError as error:
        raise Malformed(path, f"is no JSON ({error}): write it anew") from None


def read_object(path: Path) -> dict[str, Any]:
    """Object in a JSON file. Malformed for anything else."""
    found = read_json(path)
    if not isinstance(found, dict):
        raise Malformed(path, f"holds a {type(found).__name__}: the format has an object {{...}}")
    return found


def wanted_count(root: Path) -> int | None:
    """Number of images that the data set was to have; None where dataset.json has none."""
    path = root / OWN / "dataset.json"
    if not path.is_file():
        return None
    count = read_object(path).get("count")
    if not isinstance(count, int):
        raise Malformed(path, f"count is {count!r}: needs a whole number")
    return count


def read_yaml(path: Path) -> dict[Any, Any]:
    """Mapping in a YAML file. Malformed. Aliases are refused: with them a few lines can stand for
    gigabytes."""
    import yaml

    try:
        text = path.read_bytes()
        aliases = [event for event in yaml.parse(text) if isinstance(event, yaml.AliasEvent)]
        found = None if aliases else yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise Malformed(path, f"is no YAML ({reason}): write it anew") from None
    if aliases:
        line = aliases[0].start_mark.line + 1
        raise Malformed(path, f"line {line} has an alias (*name): write its value out")
    if not isinstance(found, dict):
        raise Malformed(path, f"holds a {type(found).__name__}: needs lines of `name: value`")
    return found


class Row(NamedTuple):
    """An item of an array of the top-level object, or its value at `key`; where its bytes are."""

    key: str
    value: Any
    offset: int
    length: int


class JsonRows:
    """Iterator over the items of the arrays of a JSON file's top-level object, and its other
    values, in the file's order, with one of them in memory. keys: the ones met so far.

    Bytes are decoded as Latin-1, one character per byte, so that positions are the file's; a value
    that is not ASCII is decoded once more, as UTF-8.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys: set[str] = set()
        self.text, self.at, self.start = "", 0, 0
        self.decoder = json.JSONDecoder()

    def __iter__(self) -> Iterator[Row]:
        with open(self.path, "rb") as self.file:
            yield from self.rows()

    def rows(self) -> Iterator[Row]:
        self.expect("{")
        while self.peek() != "}":
            key = self.value("").value
            self.keys.add(key)
            self.expect(":")
            if self.peek() == "[":
                yield from self.items(key)
            else:
                yield self.value(key)
            if self.peek() != "}":
                self.expect(",")

    def items(self, key: str) -> Iterator[Row]:
        self.expect("[")
        while self.peek() != "]":
            yield self.value(key)
            if self.peek() != "]":
                self.expect(",")
        self.expect("]")

    def more(self) -> bool:
        """Reads on and drops the text already parsed."""
        found = self.file.read(max(_CHUNK, len(self.text)))
        self.start += self.at
        self.text, self.at = self.text[self.at :] + found.decode("latin-1"), 0
        return bool(found)

    def peek(self) -> str:
        """The next character that is no blank."""
        while True:
            while self.at < len(self.text) and self.text[self.at] in " \t\r\n":
                self.at += 1
            if self.at < len(self.text):
                return self.text[self.at]
            if not self.more():
                raise Malformed(self.path, "is no JSON: it ends too early; write it anew")

    def expect(self, character: str) -> None:
        if self.peek() != character:
            where = self.start + self.at
            raise Malformed(
                self.path, f"is no JSON: needs {character!r} at byte {where}, has {self.peek()!r}"
            )
        self.at += 1

    def value(self, key: str) -> Row:
        self.peek()
        while True:
            try:
                found, end = self.decoder.raw_decode(self.text, self.at)
                if end < len(self.text):
                    break
            except ValueError:
                pass
            if not self.more():
                where = self.start + self.at
                raise Malformed(self.path, f"is no JSON at byte {where}: write it anew")
        text = self.text[self.at : end]
        if not text.isascii():
            found = json.loads(text.encode("latin-1"))
        row = Row(key, found, self.start + self.at, end - self.at)
        self.at = end
        return row


# ------------------------------------------------------------ fields


class Kind(NamedTuple):
    """Kind of a field's value, in words and as a test."""

    words: str
    holds: Callable[[Any], bool]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _is_finite(value: Any) -> bool:
    return _is_number(value) and abs(value) < float("inf")


INTEGER = Kind("a whole number", lambda v: isinstance(v, int) and not isinstance(v, bool))
NUMBER = Kind("a finite number", _is_finite)
TEXT = Kind("text", lambda v: isinstance(v, str))
LIST = Kind("a list", lambda v: isinstance(v, list))


def numbers(count: int) -> Kind:
    """A list of that many finite numbers."""
    return Kind(
        f"{count} finite numbers",
        lambda v: isinstance(v, list) and len(v) == count and all(map(_is_finite, v)),
    )


def fields_of(row: Any, needed: Mapping[str, Kind]) -> str:
    """Fault of the fields of an object; "" when there is none."""
    if not isinstance(row, dict):
        return f"is {row!r:.60}: needs an object with {', '.join(needed)}"
    for name, kind in needed.items():
        if name not in row:
            return f"has no {name}: needs {kind.words}"
        if not kind.holds(row[name]):
            return f"{name} is {row[name]!r:.80}: needs {kind.words}"
    return ""


# ------------------------------------------------------------ pictures


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height) by the file's header."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return picture.size
    except (OSError, ValueError, SyntaxError) as error:
        raise Malformed(path, f"is no picture that can be read ({error}): write it anew") from None


def read_picture(path: Path) -> NdArray:
    """(H, W) or (H, W, C); uint8, uint16 of a 16-bit grey one."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            pixels = np.asarray(picture)
            sixteen = picture.mode.startswith("I")
    except (OSError, ValueError, SyntaxError) as error:
        raise Malformed(path, f"is no picture that can be read ({error}): write it anew") from None
    return pixels.astype(np.uint16) if sixteen else pixels


def check_size(
    faults: Faults, check: str, path: Path, expected: tuple[int, int], source: str
) -> bool:
    """Checks that a picture is there, and of that width and height. Adds faults."""
    if not path.is_file():
        faults.add(check, path, f"is not there, and {source} names it: write it, or its entry off")
        return False
    size = picture_size(path)
    if size != tuple(expected):
        faults.add(
            check,
            path,
            f"is {size[0]}x{size[1]}, and {source} says {expected[0]}x{expected[1]}: "
            "write the size of the picture",
        )
        return False
    return True
