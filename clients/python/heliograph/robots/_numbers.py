"""Numbers in attributes. Used by urdf.py."""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Element

import numpy as np

from .._wire.arrays import NdArray
from ..values.pose import rotation_of_euler
from ._notes import Notes

_NUMBER = re.compile(r"[+-]?(inf(inity)?|(\d+\.?\d*|\.\d+)(e[+-]?\d+)?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"\d,\d")


class Numbers:
    """Reader of numbers between blanks or commas. Warns of text behind a number in its word, and of
    more numbers than are needed, and passes over them."""

    def __init__(self, notes: Notes) -> None:
        self.notes = notes

    def several(self, element: Element, key: str, count: int, where: str) -> list[float]:
        numbers = self._read(element, key, count, where)
        if not all(map(math.isfinite, numbers)):
            shown = f'{key}="{element.get(key, "")[:60]}"'
            raise self.notes.refusal(f"{shown} needs {count} finite numbers", where)
        return numbers

    def one(self, element: Element, key: str, default: float, where: str) -> float:
        return default if element.get(key) is None else self.several(element, key, 1, where)[0]

    def bound(self, element: Element, key: str, where: str) -> float:
        """A limit, which may be infinite; 0 if there is none."""
        return 0.0 if element.get(key) is None else self._read(element, key, 1, where)[0]

    def origin(self, element: Element, where: str) -> NdArray:
        """(4, 4) of the <origin> within an element."""
        out = np.eye(4)
        origin = element.find("origin")
        if origin is None:
            return out
        if origin.get("xyz") is not None:
            out[:3, 3] = self.several(origin, "xyz", 3, where)
        if origin.get("rpy") is not None:
            out[:3, :3] = rotation_of_euler(np.array(self.several(origin, "rpy", 3, where)))
        return out

    def _read(self, element: Element, key: str, count: int, where: str) -> list[float]:
        text = element.get(key)
        if text is None:
            raise self.notes.refusal(f"{key} is missing", where)
        shown = f'{key}="{text[:60]}"'
        if len(text.split()) == count and _DECIMAL_COMMA.search(text):
            raise self.notes.refusal(f"{shown}: write decimals with a point", where)
        words = text.replace(",", " ").split()
        found = [_NUMBER.match(word) for word in words[:count]]
        if not all(found):
            raise self.notes.refusal(f"{shown} holds no numbers", where)
        numbers = [float(each.group()) for each in found if each is not None]
        if len(numbers) < count:
            raise self.notes.refusal(f"{shown} needs {count} finite numbers", where)
        if [each.group() for each in found if each is not None] != words:
            self.notes.warn(
                f"{where}: {shown} is taken to be {' '.join(map('{:g}'.format, numbers))}"
            )
        return numbers
