"""Companions: files that a model refers to. Used by assets.py."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from ..errors import InvalidArgument, NotFound

#: Shift-JIS and GBK have letters whose second byte is that of a backslash, which is taken for "/".
_DOUBLE_BYTE = re.compile("(?<=[\x80-\xff])/")
#: Folders with textures, beneath a model's; the second is Gazebo's place.
_PLACES = ("", "materials/textures", "textures")


def allowed(folders: Sequence[str | os.PathLike[str]], field: str = "folders") -> list[Path]:
    """Folders whose files may be read. InvalidArgument, NotFound: they are none."""
    if isinstance(folders, (str, os.PathLike)):
        raise InvalidArgument(f"{field}: a list of folders, [{str(folders)!r}]", field=field)
    found = [Path(folder) for folder in folders]
    for folder in found:
        if not folder.is_dir():
            raise NotFound(f"{field}: there is no folder {folder}", field=field)
    return found


def find(folder: Path, name: str, folders: Sequence[str | os.PathLike[str]] = ()) -> Path | None:
    """The file that a model in `folder` calls `name`: at that path, else the file of the same name
    beneath a folder that may be read. Only what lies beneath `folder` or `folders` is found, links
    followed. The case of letters may differ, and letters be written as %20.

    name: relative, "/" separates; it may begin with "..". Bytes that are no UTF-8 read as Latin-1.
    """
    roots = [folder, *map(Path, folders)]
    real = [root.resolve() for root in roots]
    spelled = dict.fromkeys((name, unquote(name), _DOUBLE_BYTE.sub(r"\\", name)))
    for root, relative in (c for one in spelled for c in _candidates(roots, PurePosixPath(one))):
        found = _on_disk(root, relative)
        if found is not None and any(above in found.resolve().parents for above in real):
            return found
    return None


def _candidates(roots: Sequence[Path], name: PurePosixPath) -> Iterator[tuple[Path, PurePosixPath]]:
    for root in roots:
        yield root, name
        for place in _PLACES:
            yield root, PurePosixPath(place, name.name)


def _on_disk(root: Path, name: PurePosixPath) -> Path | None:
    """The file itself, or the one whose path reads the same but for the case of letters."""
    if (root / name).is_file():
        return root / name
    found = root
    for part in name.parts:
        step = found / part
        found = step if part == ".." or step.exists() else _same_name(found, part) or step
    return found if found.is_file() else None


def _same_name(folder: Path, name: str) -> Path | None:
    return next((folder / other for other in alike(folder, name)), None)


def alike(folder: Path, name: str) -> list[str]:
    """Names in a folder that equal this one but for the case of letters."""
    wanted = readable(name).casefold()
    return [other for other in names_in(folder) if readable(other).casefold() == wanted]


def names_in(folder: Path) -> list[str]:
    """Names in a folder, sorted; [] if it cannot be read."""
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def readable(name: str) -> str:
    """A file's name as text: bytes that are no UTF-8 read as Latin-1."""
    return "".join(chr(ord(c) - 0xDC00) if 0xDC80 <= ord(c) <= 0xDCFF else c for c in name)
