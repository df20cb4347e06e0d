"""The dependency rule: which layer may include which. usage: layers.py ROOT; prints file:line of each breach."""

import pathlib
import re
import sys

ALLOWED = {
    "kernels": set(),
    "renderer/base": set(),
    "renderer/scene": {"renderer/base", "kernels"},
    "renderer/assets": {"renderer/base", "renderer/scene"},
    "renderer/engine": {"renderer/base", "renderer/scene", "kernels"},
    "renderer/backend/embree": {"renderer/base", "renderer/scene", "renderer/engine", "kernels"},
    "renderer/backend": {"renderer/base", "renderer/engine", "renderer/backend/embree"},
    "server/decode": {"renderer/base", "renderer/scene", "renderer/assets", "server", "server/convert", "heliograph/v1"},
    "server": {"renderer/base", "renderer/scene", "renderer/engine", "kernels", "heliograph/v1", "server/convert", "server/decode"},
    "server/convert": {"renderer/base", "renderer/scene", "renderer/engine", "kernels", "heliograph/v1", "server"},
}
LAYERS = sorted({*ALLOWED, "heliograph/v1"}, key=len, reverse=True)
INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"')


def layer(path: str) -> str:
    return next((l for l in LAYERS if path.startswith(l + "/")), "")


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
                theirs = layer(match[1]) if match else ""
                if match and theirs != mine and theirs not in ALLOWED.get(mine, set()):
                    print(f"{name}:{number}: {mine} may not include {match[1]}")
                    breaches += 1
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
