"""XML files of others as trees: bounded in size and depth, without entities or document types."""

from __future__ import annotations

import codecs
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from ..errors import InvalidArgument, NotFound

MAX_BYTES = 64 << 20
MAX_DEPTH = 64
_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_BLANKS = b" \t\r\n\0"


def read(path: Path) -> Element:
    """The root element. Prefixes stay part of names ("xacro:macro"); none is looked up."""
    if not path.is_file():
        raise NotFound(f"no file {path}", field="path")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise InvalidArgument(
            f"{path} has {size} bytes, at most {MAX_BYTES} are read; keep meshes in files of their "
            "own",
            field="path",
        )
    return parse(path.read_bytes(), str(path))


def parse(text: bytes, where: str) -> Element:
    """The root element of a document; `where` is for messages. Blanks before it and zeros behind
    it are passed over; what says that it is UTF-8 and is not, is taken as Latin-1."""
    if not text.startswith(_WIDE):
        text = text.removeprefix(codecs.BOM_UTF8).strip(_BLANKS)
    builder = TreeBuilder()
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise _refusal(where, parser, f"is nested deeper than {MAX_DEPTH}; flatten it")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse_type(*_: object) -> None:
        raise _refusal(where, parser, "has a document type, which is not read; delete <!DOCTYPE>")

    parser = expat.ParserCreate(_encoding(text))
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse_type
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InvalidArgument(f"{where}: is no XML: {error}", field="path") from None
    root: Element = builder.close()
    return root


def _encoding(text: bytes) -> str | None:
    """What to read a document as, whatever it says of itself; None: as it says."""
    head = text[:200].partition(b"?>")[0].lower()
    if text.startswith(_WIDE) or (b"encoding" in head and b"utf-8" not in head):
        return None
    try:
        text.decode()
    except UnicodeDecodeError:
        return "iso-8859-1"
    return None


def _refusal(where: str, parser: expat.XMLParserType, message: str) -> InvalidArgument:
    line = parser.CurrentLineNumber
    return InvalidArgument(f"{where}, line {line}: {message}", field="path")
