#!/usr/bin/env python3
"""Puts the sources of assimp where CMake finds them: .venv/assimp.

Only the readers of some formats are built (cmake/HeliographAssimp.cmake). The source
package of `assimp-py` on PyPI carries the library as it was published; Debian's is two years
older (docs/decisions/049). Run by scripts/setup.
"""

from __future__ import annotations

import pathlib
import shutil

from sources import PYPI, repair, source, unpack

VERSION = "5.4.3"  # of assimp
PACKAGE = "assimp_py-1.1.0"
SOURCE = (
    PYPI + f"0b/6c/bfab1e914dc0b93a482f8093d4f04c85e8c58f0c9de341291e3d6f00744d/{PACKAGE}.tar.gz"
)
SHA256 = "ad982d33ba9ff836749a6475e145e8dcdfc106e174876ac035662301707c967c"
# Changes to its sources: what it reads wrong, and indices that it believes as a file claims them.
OFFSET = "bone->mOffsetMatrix = "
PERCENT = "blendShapeChannel->DeformPercent() / 100.0f"
REPAIRS = {
    "FBX/FBXConverter.cpp": {
        OFFSET + "bone->mOffsetMatrix * matrix;": OFFSET + "cluster->Transform();",
        f"shapeGeometries.size() > 1 ? {PERCENT} : 1.0f": PERCENT,
    },
    "X/XFileImporter.cpp": {
        f"{array}[{index}]": f"{array}.at({index})"
        for array, index in (
            ("mPosFaces", "c"),
            ("mPosFaces", "f"),
            ("mNormFaces", "f"),
            ("sourceMesh->mMaterials", "b"),
            ("mTexCoords[e]", "pf.mIndices[d]"),
            ("mColors[e]", "pf.mIndices[d]"),
            ("oldWeights", "obone.mWeights[d].mVertex"),
            ("oldWeights", "orgPoints[d]"),
        )
    },
    "3MF/XmlSerializer.cpp": {
        "aiMatrix4x4 transformMatrix;": "numbers.resize(12); aiMatrix4x4 transformMatrix;",
        **{
            f"{array}[{index}]": f"{array}.at({index})"
            for array in ("mMaterialIndex", "mTex2dCoords", "mColors")
            for index in ("pindex", "pindex[idx]")
        },
    },
}
ROOT = pathlib.Path(__file__).resolve().parent.parent / ".venv/assimp"


def put_sources(folder: pathlib.Path) -> None:
    top = f"{PACKAGE}/src/assimp/"
    names = (
        "LICENSE",
        "revision.h.in",
        "include/",
        "code/",
        "contrib/unzip/",
        "contrib/utf8cpp/",
        "contrib/stb/",
    )
    with source(SOURCE, SHA256) as archive:
        unpack(archive, {top + name: name for name in names}, folder)


if __name__ == "__main__":
    shutil.rmtree(ROOT, ignore_errors=True)
    put_sources(ROOT)
    for name, changes in REPAIRS.items():
        repair(ROOT / "code/AssetLib" / name, changes)
