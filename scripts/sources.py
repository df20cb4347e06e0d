"""Archives of sources, by their SHA-256. Used by openimageio.py, basis_universal.py, openvdb.py."""

from __future__ import annotations

import hashlib
import io
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
