#!/usr/bin/env python3
"""Puts the sources of OpenVDB and NanoVDB where CMake finds them: .venv/openvdb.

Debian's package `openvdb` is built from them. Its library is not used: it loads a logger that
starts threads (docs/decisions/048). Run by scripts/setup.

usage: scripts/openvdb.py
"""

from __future__ import annotations

import pathlib
import shutil

from sources import repair, source, unpack

VERSION = "10.0.1"
SOURCE = f"https://deb.debian.org/debian/pool/main/o/openvdb/openvdb_{VERSION}.orig.tar.xz"
SHA256 = "776706ca285a43b53e24c28d8f8b2112aea3dbf94c3c5f399cf6ff43403f5ace"
# Checks put before the places that trust a size in a file.
LONG = 'if ({0} > 1u << 24) OPENVDB_THROW(IoError, "a text is longer than 16 MiB"); '
WRONG = 'if (size_t(-{0}) != numBytes) OPENVDB_THROW(RuntimeError, "a block has a wrong size"); '
LARGE = (
    "if (size_t({0}) > numBytes + 4096) "
    'OPENVDB_THROW(RuntimeError, "a block is larger than its voxels"); '
)
REPAIRS = {
    "io/Compression.cc": {
        "is.read(data, -numZippedBytes);": WRONG.format("numZippedBytes"),
        "is.read(data, -numCompressedBytes);": WRONG.format("numCompressedBytes"),
        "std::unique_ptr<Bytef[]> zippedData(new Bytef[numZippedBytes]);\n"
        "            is.read": LARGE.format("numZippedBytes"),
        "std::unique_ptr<char[]> compressedData(new char[numCompressedBytes])": LARGE.format(
            "numCompressedBytes"
        ),
        "const int numUncompressedBytes = blosc_decompress_ctx(": "size_t claimed = 0; "
        "if (blosc_cbuffer_validate(compressedData.get(), numCompressedBytes, &claimed) < 0) "
        'OPENVDB_THROW(RuntimeError, "a block is damaged"); ',
    },
    "util/Name.h": {"std::string buffer(size, ' ');": LONG.format("size")},
    "Metadata.h": {"mValue.resize(size, '\\0');": LONG.format("size")},
    "Metadata.cc": {"ByteVec buffer(numBytes);": LONG.format("numBytes")},
}
# A bool is a byte of the file, which may have any value: not 0 becomes true.
MEND = """
template<typename T> inline void mendBools(T* values, size_t count)
{
    if constexpr (std::is_same_v<T, bool>)
        for (size_t i = 0; values && i < count; ++i) {
            unsigned char byte;
            std::memcpy(&byte, values + i, 1);
            values[i] = byte != 0;
        }
}
"""
VALUE = "is.read(reinterpret_cast<char*>(&{0}), sizeof(ValueType));"
INACTIVE = "is.read(reinterpret_cast<char*>(&{0}), /*bytes=*/sizeof(ValueT));"
BOOLS = {
    "Metadata.h": {"is.read(reinterpret_cast<char*>(&mValue), this->size());": "&mValue, 1"},
    "tree/RootNode.h": {
        VALUE.format("mBackground"): "&mBackground, 1",
        VALUE.format("value"): "&value, 1",
        "is.read(reinterpret_cast<char*>(&active), sizeof(bool));": "&active, 1",
    },
    "tree/InternalNode.h": {VALUE.format("value"): "&value, 1"},
    "io/Compression.h": {
        INACTIVE.format("inactiveVal0"): "&inactiveVal0, 1",
        INACTIVE.format("inactiveVal1"): "&inactiveVal1, 1",
        "        readData(is, data, count, compression, metadata, metadataOffset);": "data, count",
    },
}
# Boost 1.74's header for this does not compile with clang 20 or later, thus not with clang-tidy.
PROMOTED = """typename std::conditional_t<std::is_class_v<S>, std::common_type<S>,
        std::conditional_t<std::is_class_v<T>, std::common_type<T>,
            std::common_type<S, T>>>::type"""
REPLACED = {
    "#include <boost/numeric/conversion/conversion_traits.hpp>": "#include <type_traits>",
    "typename boost::numeric::conversion_traits<S, T>::supertype": PROMOTED,
}
ROOT = pathlib.Path(__file__).resolve().parent.parent / ".venv/openvdb"


def put_sources(folder: pathlib.Path) -> None:
    """The folders openvdb/ and nanovdb/ of the library, and its licence."""
    prefixes = {
        f"openvdb-{VERSION}/openvdb/openvdb/": "openvdb/",
        f"openvdb-{VERSION}/nanovdb/nanovdb/": "nanovdb/",
        f"openvdb-{VERSION}/LICENSE": "LICENSE",
    }
    with source(SOURCE, SHA256) as archive:
        unpack(archive, prefixes, folder)


if __name__ == "__main__":
    shutil.rmtree(ROOT, ignore_errors=True)
    put_sources(ROOT)
    for name, checks in REPAIRS.items():
        repair(ROOT / "openvdb" / name, {place: check + place for place, check in checks.items()})
    repair(ROOT / "openvdb/math/Math.h", REPLACED)
    scalars = "// One-dimensional scalar types"
    repair(
        ROOT / "openvdb/Types.h",
        {scalars: MEND + scalars, "<memory>": "<memory>\n#include <cstring>"},
    )
    for name, places in BOOLS.items():
        repair(
            ROOT / "openvdb" / name,
            {place: f"{place} mendBools({what});" for place, what in places.items()},
        )
