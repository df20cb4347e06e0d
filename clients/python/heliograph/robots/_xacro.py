"""Remains of a URDF template (xacro) in a file. Used by urdf.py.

Source: the xacro documentation of ROS (wiki.ros.org/xacro).
"""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Iterator
from xml.etree.ElementTree import Element

from ..errors import InvalidArgument
from ._notes import Notes

_OPTENV = re.compile(r"\$\(optenv\s+\w+\s*([^()$]*)\)")
_HARMLESS = ("xacro:property", "xacro:arg")  # they name values, which nothing asks for here


def settle(root: Element, notes: Notes) -> None:
    """Puts the default for $(optenv NAME default). Refuses a file whose links, joints or visuals
    are still templates; warns of templates elsewhere."""
    read = list(_read(root))
    for element in read:
        for key, text in element.attrib.items():
            if _OPTENV.search(text):
                element.set(key, _OPTENV.sub(r"\1", text))
                notes.warn(f'{text}: taken as "{element.get(key)}", whatever the environment says')
    if notes.path.suffix == ".xacro" or any(map(_is_template, read)):
        raise _refusal(notes)
    if any(_is_template(element) or element.tag in _HARMLESS for element in root.iter()):
        notes.warn("has leftovers of xacro in parts that are not read")


def _read(root: Element) -> Iterator[Element]:
    """The elements that a robot is made of."""
    for element in root:
        if element.tag not in ("link", "joint", "material"):
            if element.tag.startswith("xacro:"):
                yield element
        elif element.tag != "link":
            yield from element.iter()
        else:
            yield element
            for part in element:
                if part.tag == "visual" or part.tag.startswith("xacro:"):
                    yield from part.iter()


def _is_template(element: Element) -> bool:
    if element.tag.startswith("xacro:"):
        return element.tag not in _HARMLESS
    return any("${" in text or "$(" in text for text in element.attrib.values())


def _refusal(notes: Notes) -> InvalidArgument:
    path = notes.path
    stem = path.name.split(".")[0]
    names = (f"{stem}_expanded{n or ''}.urdf" for n in itertools.count())
    free = next(name for name in names if not (path.parent / name).exists())
    return InvalidArgument(
        f"{path} is xacro, a template of URDF: expand it first, with "
        f"`xacro {shlex.quote(path.name)} > {shlex.quote(free)}`",
        field="path",
    )
