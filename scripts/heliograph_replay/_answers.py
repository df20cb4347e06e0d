"""Differences between a recorded answer and one that came. Used by _questions.py."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

from google.protobuf.message import Message
from heliograph._wire._proto import service_pb2 as service
from heliograph.errors import HeliographError

from ._calls import arrays_of, key_of, outcome

_LONG = 4096  # bytes; of a longer field a recording holds the SHA-256


def difference_of(was: Any, found: Any) -> str:
    """Between two answers, each a message, the HeliographError that ended the call, or None; "":
    none. Errors differ in code or field.
    """
    if found is None:
        return "an answer is missing"
    if was is None:
        return outcome(found) if isinstance(found, HeliographError) else "there is one answer more"
    if isinstance(was, HeliographError) or isinstance(found, HeliographError):
        return "" if key_of(was) == key_of(found) else f"{outcome(found)}; it was {outcome(was)}"
    _shorten(found)
    for answer in (was, found):
        _drop_passing(answer)
    return next(_differences(was, found), "")


def _shorten(message: Any) -> None:
    """Replaces long bytes by their SHA-256, as recording.proto does in a question's replies."""
    for field, value in message.ListFields():
        if isinstance(value, Message):
            _shorten(value)
        elif isinstance(value, bytes):
            if len(value) > _LONG:
                setattr(message, field.name, hashlib.sha256(value).digest())
        elif field.message_type is not None and not isinstance(value, Mapping):
            for inner in value:
                _shorten(inner)


def _drop_passing(answer: Any) -> None:
    """Drops fields that another run of the same calls may answer otherwise."""
    if isinstance(answer, service.DescribeSceneReply):
        answer.scene.ClearField("scene")
        answer.scene.ClearField("next_edit")
        answer.ClearField("memory")
    elif isinstance(answer, service.WatchReply):
        for array in arrays_of(answer):
            for source in ("upload", "buffer"):
                array.ClearField(source)


def _differences(was: Any, found: Any, path: str = "") -> Iterator[str]:
    """Between two messages of a kind, by the fields' paths."""
    if was == found:
        return
    present = {field.name: field for message in (was, found) for field, _ in message.ListFields()}
    for name in sorted(present, key=lambda name: present[name].number):
        old, new = getattr(was, name), getattr(found, name)
        place = f"{path}{name}"
        if isinstance(old, Message):
            if was.HasField(name) != found.HasField(name):
                yield f"{place} is {'absent' if was.HasField(name) else 'there'}; it was not"
            else:
                yield from _differences(old, new, f"{place}.")
        elif isinstance(old, Mapping):
            yield from _differences_of_maps(old, new, place)
        elif isinstance(old, bytes):
            if old != new:
                yield f"{place} has other values"
        elif isinstance(old, (str, int, float)):
            if old != new:
                yield f"{place} is {new!r}; it was {old!r}"
        else:
            yield from _differences_of_lists(old, new, place)


def _differences_of_maps(was: Any, found: Any, path: str) -> Iterator[str]:
    for key in sorted({*was, *found}):
        old, new = was.get(key), found.get(key)
        if old != new:
            yield f"{path}[{key}] is {new!r}; it was {old!r}"


def _differences_of_lists(was: Any, found: Any, path: str) -> Iterator[str]:
    if len(was) != len(found):
        yield f"{path} has {len(found)} items; it had {len(was)}"
        return
    for index, (old, new) in enumerate(zip(was, found, strict=True)):
        if isinstance(old, Message):
            name = getattr(old, "name", "")
            yield from _differences(old, new, f"{path}[{name or index}].")
        elif old != new:
            yield f"{path}[{index}] is {new!r}; it was {old!r}"
