"""The files that a robot's file refers to, and no others. Used by urdf.py."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from ..scene import companions
from ..scene.companions import alike, names_in
from ._notes import Notes

_MARKS = ("package.xml", "__init__.py")  # of packages of ROS and of Python
_DESCRIPTIONS = {"urdf", "robots"}
_MESHES = {"mesh", "meshes", "assets"}


class Files:
    """Files of a robot: in the folder of the robot's file, in its package, or in one of `packages`:
    folders by the names in package:// references."""

    def __init__(self, notes: Notes, packages: Mapping[str, str | os.PathLike[str]]) -> None:
        self.notes = notes
        self.folder = notes.path.parent.resolve()
        given = companions.allowed(list(packages.values()), "packages")
        self.packages = {name: at.resolve() for name, at in zip(packages, given)}
        self.own = list(_own_packages(self.folder))

    def find(self, reference: str, where: str) -> Path:
        """The file of a reference. Raises NotFound, InvalidArgument where it is not to be read."""
        scheme, _, rest = _as_url(reference.strip().replace("\\", "/")).rpartition("://")
        if not rest.strip("/"):
            raise self.notes.refusal("a filename is missing", where)
        if scheme in ("package", "model"):
            return self._in_package(rest.lstrip("/"), where)
        if scheme not in ("", "file"):
            raise self.notes.refusal(f"{reference!r}: only files are read; download it", where)
        for root in (self.folder, *self.own):
            found = _existing(root / rest, self.roots())
            if found is not None:
                return found
        if re.match("/|[A-Za-z]:", rest):
            found = self._of_another_machine(rest, where)
            if found is not None:
                return found
        path = (self.folder / rest).resolve()
        if not _is_within(path, self.roots()):
            raise self.notes.refusal(
                f"{reference!r} lies outside the file's own folder and package; allow its folder "
                f'with packages={{"meshes": {str(path.parent)!r}}}',
                where,
            )
        raise self.notes.missing(f"no file {path}", where)

    def roots(self) -> list[Path]:
        """Folders whose files may be read."""
        return [self.folder, *self.packages.values(), *self.own]

    def _in_package(self, rest: str, where: str) -> Path:
        name, _, within = rest.partition("/")
        folders = [self.packages[name]] if name in self.packages else [*self._called(name)]
        for folder in (*folders, *self.own):
            found = _existing(folder / within.lstrip("/"), [folder, *self.roots()])
            if found is not None:
                self.packages.setdefault(name, folder)
                return found
        if folders:
            raise self.notes.missing(f"no file {folders[0] / within}", where)
        raise self.notes.missing(
            f'where package {name!r} is, is not known: give packages={{"{name}": "its folder"}}',
            where,
            field="packages",
        )

    def _called(self, name: str) -> Iterator[Path]:
        """Packages of a name above the file, or within folders above it, and the file's own folder
        and its folders."""
        for folder in (self.folder, *self.folder.parents):
            for found in (folder, folder / name):
                is_own = folder == self.folder and found.is_dir()
                if found.name == name and (is_own or _is_package(found)):
                    yield found

    def _of_another_machine(self, absolute: str, where: str) -> Path | None:
        """The file with the longest end in common with an absolute path that leads nowhere."""
        parts = PurePosixPath(absolute).parts[1:]
        for start in range(len(parts)):
            for root in (self.folder, *self.own):
                found = _existing(root.joinpath(*parts[start:]), self.roots())
                if found is not None:
                    self.notes.warn(f"{where}: {absolute!r} is taken to be {found}")
                    return found
        return None


def _as_url(reference: str) -> str:
    """file:/place and file://localhost/place are file:///place."""
    return re.sub("^file:(//localhost)?(?=/[^/])", "file://", reference)


def _existing(path: Path, roots: Sequence[Path]) -> Path | None:
    """A file beneath roots, also where letters differ in case or are written as %20."""
    for spelled in (str(path), unquote(str(path))):
        plain = Path(os.path.normpath(spelled))
        if _is_within(plain.resolve(), roots):
            found = plain if plain.is_file() else _ignoring_case(plain)
            if found is not None and _is_within(found.resolve(), roots):
                return found.resolve()
    return None


def _is_within(path: Path, roots: Sequence[Path]) -> bool:
    return any(root in path.parents for root in roots)


def _own_packages(folder: Path) -> Iterator[Path]:
    """The packages that a folder is in: the nearest folders, from it upwards, that have a mark of
    ROS or of Python; and one that has descriptions beside meshes, at most two above it."""
    above = (folder, *folder.parents)
    for mark in _MARKS:
        yield from [at for at in above if (at / mark).is_file()][:1]
    yield from [at for at in above[:3] if _has_meshes_beside(at)][:1]


def _is_package(folder: Path) -> bool:
    return any((folder / mark).is_file() for mark in _MARKS) or _has_meshes_beside(folder)


def _has_meshes_beside(folder: Path) -> bool:
    names = {name.lower() for name in names_in(folder)}
    return not (names.isdisjoint(_DESCRIPTIONS) or names.isdisjoint(_MESHES))


def _ignoring_case(path: Path) -> Path | None:
    """The one file that is called so but for the case of letters."""
    at = Path(path.anchor)
    for part in path.parts[1:]:
        if not (at / part).exists():
            same = alike(at, part)
            if len(same) != 1:
                return None
            part = same[0]
        at = at / part
    return at if at.is_file() else None
