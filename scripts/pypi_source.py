"""Source packages of PyPI, by their SHA-256. Used by openimageio.py and basis_universal.py."""

from __future__ import annotations

import hashlib
import io
import tarfile
import urllib.request

PACKAGES = "https://files.pythonhosted.org/packages/"


def pypi_source(path: str, sha256: str) -> tarfile.TarFile:
    """The archive at a path below PACKAGES; ends the program when it is another one."""
    url = PACKAGES + path
    with urllib.request.urlopen(url, timeout=120) as reply:
        data = reply.read()
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise SystemExit(f"{url} has the SHA-256 {found}, not {sha256}")
    return tarfile.open(fileobj=io.BytesIO(data))
