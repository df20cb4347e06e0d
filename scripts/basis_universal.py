#!/usr/bin/env python3
"""Puts the Basis Universal transcoder where CMake finds it: .venv/basis_universal.

No distribution has it. The source package of `opengl-basisu` on PyPI carries the transcoder of
Basis Universal's tag v2_50 (commit 9bebe16), byte for byte; nothing else of it is taken, and
Zstandard is the distribution's (docs/decisions/051). Run by scripts/setup.
"""

from __future__ import annotations

import pathlib
import shutil

from sources import PYPI, source, unpack

VERSION = "2.50"  # of Basis Universal
PACKAGE = "opengl_basisu-0.1.0a2"
SOURCE = (
    PYPI + f"a8/6a/b242409d87a74b0f7715af6e26a888d3eaa443fee738fa1b28f32ec27bec/{PACKAGE}.tar.gz"
)
SHA256 = "7364dc63ac0e65f1d32306236514b834e06a22081d1019e8241d8f0a2a6cfeb5"
ROOT = pathlib.Path(__file__).resolve().parent.parent / ".venv/basis_universal"


def put_files(folder: pathlib.Path) -> None:
    top = f"{PACKAGE}/vendor/basis_universal/"
    names = ("transcoder/", "LICENSE", "NOTICE")
    with source(SOURCE, SHA256) as archive:
        unpack(archive, {top + name: name for name in names}, folder)
    header = folder / "zstd/zstd.h"
    header.parent.mkdir()
    header.write_text("#include <zstd.h>\n")


if __name__ == "__main__":
    shutil.rmtree(ROOT, ignore_errors=True)
    put_files(ROOT)
