"""Plants breaches of the Python packages' dependency rules in a small tree; python_layers.py must
name each one."""

import os
import pathlib
import subprocess
import sys
import tempfile

LAYERS = pathlib.Path(__file__).with_name("python_layers.py")
PACKAGE = pathlib.Path("clients/python/heliograph")
NVISII = "../../nvisii/nvisii"  # from there
REPLAY = "../../../scripts/heliograph_replay"
CLEAN = {
    "__init__.py": "from .errors import Error\n",
    "errors.py": "Error = Exception\n",
    "values/__init__.py": "",
    "values/pose.py": "from ..errors import Error\n",
    "scene/__init__.py": "",
    "scene/edit.py": (
        "from typing import TYPE_CHECKING\nfrom ..values import pose\n"
        "if TYPE_CHECKING:\n    from ..client.scene import Scene\n"
    ),
    "client/__init__.py": "",
    "client/scene.py": "from ..scene.edit import pose\n",
    "cli/__init__.py": "import heliograph\n",
    f"{NVISII}/__init__.py": "import heliograph.client.scene\n",
    f"{REPLAY}/reader.py": "from heliograph.client import scene\n",
}
BREACHES = {
    "values/light.py": "from ..errors import Error\nfrom ..scene import edit\n",
    "values/camera.py": "import heliograph.client.scene\n",
    "scene/late.py": "def call():\n    from ..client.scene import pose\n",
    "client/name.py": "from .. import Error\n",
    "robots/arm.py": "import numpy\nif True:\n    from ..client import scene\n",
    "newcomer.py": "",
    "scene/named.py": 'import importlib\nimportlib.import_module("heliograph.client.scene")\n',
    "scene/dotted.py": 'from importlib import import_module\nimport_module("..client", "x")\n',
    "values/unchecked.py": "if not TYPE_CHECKING:\n    from ..scene import edit\n",
    "scene/user.py": "import nvisii\n",
    "cli/replay.py": "def run():\n    import heliograph_replay.reader\n",
    f"{NVISII}/recorded.py": "from heliograph_replay import reader\n",
}
CIRCLES = {
    "heliograph.scene.a, heliograph.scene.b, heliograph.scene.c": {
        "scene/a.py": "from .b import x\n",
        "scene/b.py": "from .c import x\n",
        "scene/c.py": "def call():\n    from . import a\n",
    },
    "heliograph.scene.a, heliograph.scene.b": {
        "scene/a.py": "from . import b\n",
        "scene/b.py": "from .a import x\n",
    },
    "heliograph.values, heliograph.values.a": {
        "values/__init__.py": "from .a import x\n",
        "values/a.py": "from . import x\n",
    },
    "nvisii.a, nvisii.b": {
        f"{NVISII}/a.py": "from .b import x\n",
        f"{NVISII}/b.py": "import nvisii.a\n",
    },
}


def run(files: dict[str, str]) -> tuple[int, str]:
    with tempfile.TemporaryDirectory() as root:
        for name, text in files.items():
            path = pathlib.Path(root, PACKAGE, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        done = subprocess.run(
            [sys.executable, LAYERS, root], capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout


def main() -> int:
    code, out = run(CLEAN)
    assert code == 0 and not out, out
    for name, text in BREACHES.items():
        code, out = run({**CLEAN, name: text})
        line = max(1, text.count("\n"))
        where = os.path.normpath(PACKAGE / name)
        assert code == 1 and out.startswith(f"{where}:{line}: "), (name, code, out)
        assert out.count("\n") == 1, out
    for circle, files in CIRCLES.items():
        code, out = run({**CLEAN, **files})
        assert code == 1 and out.endswith(f":1: a circle of imports: {circle}\n"), (circle, out)
        assert out.count("\n") == 1, out
    print(f"{len(BREACHES) + len(CIRCLES)} planted breaches found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
