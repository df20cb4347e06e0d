"""XML files of others as trees: bounded in size and depth, without entities or document types."""

from __future__ import annotations

import codecs
import contextlib
import re
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from ..errors import InvalidArgument, NotFound

MAX_BYTES = 64 << 20
MAX_DEPTH = 64
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
    b"<\0": "utf-16-le",
    b"\0<": "utf-16-be",
}
_BLANKS = " \t\r\n\0"
_DECLARATION = re.compile(r"<\?xml\s[^>]*\?>")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_ENCODING = re.compile(rb"""<\?xml[^>]*?encoding\s*=\s*["']([\w.:-]+)["']""")


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
    it are passed over, and so are comments, which others close with more dashes."""
    plain = _decoded(text).strip(_BLANKS)
    for unread in (_COMMENT, _DECLARATION):
        plain = unread.sub(lambda found: "\n" * found.group().count("\n"), plain)
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

    def refuse_type(name: str, system: str | None, public: str | None, has_subset: bool) -> None:
        if has_subset:
            raise _refusal(where, parser, "has a document type of its own; delete <!DOCTYPE>")

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse_type
    try:
        parser.Parse(plain.encode(), True)
    except expat.ExpatError as error:
        raise InvalidArgument(f"{where}: is no XML: {error}", field="path") from None
    root: Element = builder.close()
    return root


def _decoded(data: bytes) -> str:
    """Text of a file: by its byte order mark or the width of letters, else by the encoding that the
    document names; bytes that do not fit that are UTF-8, or else Latin-1."""
    for mark, name in _MARKS.items():
        if data.startswith(mark):
            return data.decode(name, "replace").removeprefix("\ufeff")
    declared = _ENCODING.search(data[:200])
    names = [declared.group(1).decode().lower()] if declared else []
    for name in (*names, "utf-8"):
        if not name.startswith(("utf-16", "utf-32", "ucs")):
            with contextlib.suppress(LookupError, UnicodeDecodeError):
                return data.decode(name)
    return data.decode("iso-8859-1")


def _refusal(where: str, parser: expat.XMLParserType, message: str) -> InvalidArgument:
    line = parser.CurrentLineNumber
    return InvalidArgument(f"{where}, line {line}: {message}", field="path")
