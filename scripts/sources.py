"""Archives of sources, by their SHA-256. Used by assimp.py, basis_universal.py, openimageio.py,
openvdb.py."""

from __future__ import annotations

import hashlib
import io
import pathlib
import tarfile
import urllib.request

PYPI = "https://files.pythonhosted.org/packages/"


def source(url: str, sha256: str) -> tarfile.TarFile:
    """The archive at a URL; ends the program when it is another one."""
    with urllib.request.urlopen(url, timeout=120) as reply:
        data = reply.read()
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise SystemExit(f"{url} has the SHA-256 {found}, not {sha256}")
    return tarfile.open(fileobj=io.BytesIO(data))


def repair(path: pathlib.Path, changes: dict[str, str]) -> None:
    """Replaces text of a file; ends the program if it lacks that text."""
    text = path.read_text()
    for old, new in changes.items():
        if old not in text:
            raise SystemExit(f"{path} lacks the text to repair: {old}")
        text = text.replace(old, new)
    path.write_text(text)


def unpack(archive: tarfile.TarFile, places: dict[str, str], folder: pathlib.Path) -> None:
    """Puts files whose names in the archive begin with a key of `places` into `folder`, where
    its value takes the key's place."""
    for member in archive.getmembers():
        for prefix, to in places.items():
            if not member.isfile() or not member.name.startswith(prefix):
                continue
            data = archive.extractfile(member)
            assert data is not None
            path = folder / to / member.name.removeprefix(prefix)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data.read())
