"""The dependency rule: which layer may include which, and which may include a heavy library.

usage: layers.py ROOT; prints file:line of each breach. Run by ctest.
       layers.py --pages ROOT; prints each room whose README.md does not list what it may include.
"""

import pathlib
import re
import sys

KERNELS = {
    "kernels/core": "",
    "kernels/scene": "core",
    "kernels/material": "core scene",
    "kernels/geometry": "core scene material",
    "kernels/camera": "core scene geometry",
    "kernels/bsdf": "core scene geometry",
    "kernels/light": "core scene geometry",
    "kernels/media": "core scene geometry",
    "kernels/bvh": "core scene geometry",
    "kernels/ingest": "core",
    "kernels/integrator": "core scene geometry camera bsdf light media",
    "kernels/schedule": "core scene geometry camera light integrator",
    "kernels/label": "core scene geometry camera light media integrator",
}
RENDERER = {
    "renderer/base": "",
    "renderer/scene": "base",
    "renderer/assets": "base scene",
    "renderer/frame": "base scene",
    "renderer/device": "base scene frame",
    "renderer/post": "base frame",
    "renderer/derived": "base scene",
    "renderer/placement": "base scene frame device derived",
    "renderer/lights": "base scene derived placement",
    "renderer/resident": "base scene frame device derived placement lights",
    "renderer/host": "base scene frame device placement resident",
    "renderer/bvh": "base device placement host",
    "renderer/backend/embree": "base device placement resident host",
    "renderer/backend/cuda": "base scene frame device post resident host bvh",
    "renderer/backend": "device backend/embree backend/cuda",
    "renderer/schedule": "base scene frame device post",
}
# Every room may see the renderer's scenes and jobs, and the wire; os has no use for them.
SERVER = {
    "server/os": "",
    "server/config": "os decode",
    "server/quota": "config",
    "server/convert": "os",
    "server/decode": "convert",
    "server/device": "os",
    "server/store": "os quota convert",
    "server/access": "os config quota store",
    "server/observe": "os convert",
    "server/session": "os convert quota store access",
    "server/net": "os config access",
    "server/journal": "os convert quota decode store access session",
    "server/scene": "os convert quota store access session journal",
    "server/calls": "os config quota convert decode device store access observe session net journal"
    " scene",
    "server/app": "os config access observe session net calls",
}


def arrows(table: dict[str, str], root: str, seen: set[str]) -> dict[str, set[str]]:
    return {
        room: {f"{root}/{name}" for name in names.split()} | seen for room, names in table.items()
    }


ROOMS_OF_KERNELS = set(KERNELS)
SEEN_BY_THE_SERVER = {f"renderer/{room}" for room in "base scene frame device schedule".split()}
ALLOWED = (
    arrows(KERNELS, "kernels", set())
    | arrows(RENDERER, "renderer", ROOMS_OF_KERNELS)
    | arrows(
        SERVER,
        "server",
        {*SEEN_BY_THE_SERVER, "heliograph/v1", "google/rpc", *ROOMS_OF_KERNELS},
    )
)
ALLOWED["server/decode"] |= {"renderer/assets"}
ALLOWED["renderer/base"] = set()
ALLOWED["server/os"] -= {"renderer/schedule", "heliograph/v1", "google/rpc"}
ALLOWED["server/config"] -= {"heliograph/v1", "google/rpc"}
LAYERS = sorted(
    {*ALLOWED, "heliograph/v1", "google/rpc", "kernels", "renderer", "server"},
    key=len,
    reverse=True,
)
GRPC = {f"server/{room}" for room in "app calls convert net observe session".split()}
LIBRARIES = {
    "embree3": {"renderer/backend/embree"},
    "embree4": {"renderer/backend/embree"},
    "OpenImageIO": {"renderer/assets"},
    "assimp": {"renderer/assets"},
    "basisu_transcoder.h": {"renderer/assets"},
    "openvdb": {"renderer/assets"},
    "nanovdb": {"renderer/assets"},
    "tiny_gltf.h": {"renderer/assets"},
    "spdlog": {"server/os"},
    "sqlite3.h": {"server/journal"},
    "grpcpp": GRPC,
    "google": GRPC | {"server/decode", "server/journal", "server/os", "server/scene"},
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


def wrong_pages(root: pathlib.Path) -> int:
    wrong = 0
    for room, names in (KERNELS | RENDERER | SERVER).items():
        page = root / room / "README.md"
        line = f"May include: {', '.join(names.split()) or 'no other room'}."
        if not page.exists() or line not in page.read_text().splitlines():
            print(f"{page.relative_to(root)}: has no line '{line}'")
            wrong += 1
    return 1 if wrong else 0


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
    pages = sys.argv[1] == "--pages"
    sys.exit((wrong_pages if pages else main)(pathlib.Path(sys.argv[-1])))
