#!/usr/bin/env python3
"""Puts OpenImageIO where CMake finds it: .venv/openimageio, with include/ and lib/.

The library is that of the wheel in .venv, which needs no other package (docs/decisions/047). Wheels
have no headers: those come from the source package of the same version. Run by scripts/setup.

usage: scripts/openimageio.py [--requirement]   --requirement: prints what pip installs
"""

from __future__ import annotations

import importlib.metadata
import pathlib
import re
import shutil
import sys

from sources import PYPI, source

VERSION = "3.2.2.0"
SOURCE = (
    "c3/7f/7a49e65b7f49f859c213e1d6ce19d32ce568d4ed15385898c2f65314e536/"
    f"openimageio-{VERSION}.tar.gz"
)
SHA256 = "d66c829016b4f092c443b7f7896f06d0ab6af02a103d635d1b0b841c14bfd7c1"
ROOT = pathlib.Path(__file__).resolve().parent.parent / ".venv/openimageio"
# Values that the library was built with: `nm -DC` shows the namespace.
VALUES = {
    "PROJECT_VERSION_MAJOR": "3",
    "PROJECT_VERSION_MINOR": "2",
    "PROJECT_VERSION_PATCH": "2",
    "PROJECT_VERSION_TWEAK": "0",
    "PROJECT_VERSION_RELEASE_TYPE": "",
    "PROJ_NAMESPACE": "OpenImageIO",
    "PROJ_VERSION_NAMESPACE": "v3_1",
    "OIIO_USE_COMPILED_FMT_VALUE": "0",
    "Imath_VERSION_MAJOR": "3",
    "Imath_VERSION_MINOR": "1",
    "CMAKE_CXX_STANDARD": "17",
}


def configured(template: str) -> str:
    """A header as CMake's configure_file makes it."""
    text = re.sub(r"@(\w+)@", lambda found: VALUES[found[1]], template)
    return re.sub(r"#cmakedefine01 (\w+)", r"#define \1 0", text)


def put_headers(folder: pathlib.Path) -> None:
    prefix = f"openimageio-{VERSION}/src/include/"
    with source(PYPI + SOURCE, SHA256) as archive:
        for member in archive.getmembers():
            name = member.name.removeprefix(prefix)
            if name == member.name or not member.isfile():
                continue
            data = archive.extractfile(member)
            assert data is not None
            text = data.read().decode()
            path = folder / name.removesuffix(".in")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(configured(text) if name.endswith(".in") else text)
    for name in ("format", "ostream", "printf"):  # of its build, which has fmt within
        path = folder / f"OpenImageIO/detail/fmt/{name}.h"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#include <fmt/{name}.h>\n")


def link_libraries(folder: pathlib.Path) -> None:
    found = importlib.metadata.distribution("openimageio")
    if found.version != VERSION:
        raise SystemExit(f"openimageio: .venv has {found.version}, not {VERSION}")
    folder.mkdir(parents=True)
    for file in found.files or []:
        name = re.fullmatch(r"(libOpenImageIO\w*\.so)\.[\d.]+", file.name)
        if name:
            (folder / file.name).symlink_to(pathlib.Path(found.locate_file(file)).resolve())
            (folder / name[1]).symlink_to(file.name)


if __name__ == "__main__":
    if sys.argv[1:] == ["--requirement"]:
        raise SystemExit(print(f"openimageio=={VERSION}"))
    shutil.rmtree(ROOT, ignore_errors=True)
    link_libraries(ROOT / "lib")
    put_headers(ROOT / "include")
