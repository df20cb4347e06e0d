"""The dependency rule: which layer may include which, and which may include a heavy library.

usage: layers.py ROOT; prints file:line of each breach. Run by ctest.
"""

import pathlib
import re
import sys

ALLOWED = {
    "kernels": set(),
    "renderer/base": set(),
    "renderer/scene": {"renderer/base", "kernels"},
    "renderer/assets": {"renderer/base", "renderer/scene", "kernels"},
    "renderer/engine": {"renderer/base", "renderer/scene", "kernels"},
    "renderer/resident": {"renderer/base", "renderer/scene", "renderer/engine", "kernels"},
    "renderer/bvh": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "renderer/resident",
        "renderer/host",
        "kernels",
    },
    "renderer/host": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "renderer/resident",
        "kernels",
    },
    "renderer/backend/embree": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "renderer/resident",
        "renderer/host",
        "kernels",
    },
    "renderer/backend/cuda": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "renderer/resident",
        "renderer/host",
        "renderer/bvh",
        "kernels",
    },
    "renderer/backend": {
        "renderer/base",
        "renderer/engine",
        "renderer/backend/embree",
        "renderer/backend/cuda",
    },
    "server/decode": {
        "renderer/base",
        "renderer/scene",
        "renderer/assets",
        "server",
        "server/convert",
        "heliograph/v1",
    },
    "server/journal": {
        "renderer/base",
        "renderer/scene",
        "heliograph/v1",
        "server",
        "server/convert",
        "server/decode",
    },
    "server": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "kernels",
        "heliograph/v1",
        "server/convert",
        "server/decode",
        "server/journal",
    },
    "server/convert": {
        "renderer/base",
        "renderer/scene",
        "renderer/engine",
        "kernels",
        "heliograph/v1",
        "server",
    },
}
LAYERS = sorted({*ALLOWED, "heliograph/v1"}, key=len, reverse=True)
LIBRARIES = {
    "embree3": {"renderer/backend/embree"},
    "embree4": {"renderer/backend/embree"},
    "OpenImageIO": set(),
    "OpenEXR": {"renderer/assets"},
    "openvdb": {"renderer/assets"},
    "nanovdb": {"renderer/assets", "kernels"},
    "tiny_gltf.h": {"renderer/assets"},
    "sqlite3.h": {"server/journal"},
    "grpcpp": {"server", "server/convert"},
    "google": {"server", "server/convert", "server/decode", "server/journal"},
}
INCLUDE = re.compile(r'^\s*#\s*include\s+(?:"([^"]+)"|<([^>]+)>)')


def layer(path: str) -> str:
    return next((name for name in LAYERS if path.startswith(name + "/")), "")


def breach(mine: str, own: str | None, library: str | None) -> bool:
    if own is not None:
        theirs = layer(own)
        return theirs != mine and theirs not in ALLOWED.get(mine, set())
    users = LIBRARIES.get(str(library).split("/")[0])
    return users is not None and mine not in users


def main(root: pathlib.Path) -> int:
    breaches = 0
    for folder in ("kernels", "renderer", "server"):
        for file in sorted((root / folder).rglob("*")):
            if file.suffix not in {".h", ".cpp", ".cu"}:
                continue
            name = file.relative_to(root).as_posix()
            mine = layer(name)
            for number, line in enumerate(file.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                if match and breach(mine, match[1], match[2]):
                    print(f"{name}:{number}: {mine} may not include {match[1] or match[2]}")
                    breaches += 1
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
