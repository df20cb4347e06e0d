"""Plants breaches of the dependency rule in a small tree; layers.py must name each one."""

import pathlib
import subprocess
import sys
import tempfile

LAYERS = pathlib.Path(__file__).with_name("layers.py")
CLEAN = {
    "kernels/integrator/path.h": '#include "kernels/scene/ray.h"\n',
    "renderer/scene/scene.cpp": '#include "renderer/base/error.h"\n',
    "renderer/backend/registry.cpp": '#include "renderer/backend/embree/backend.h"\n',
    "server/convert/frame.cpp": '#include "heliograph/v1/render.pb.h"\n',
}
BREACHES = {
    "kernels/bsdf/bsdf.h": '#include <cmath>\n#include "renderer/base/error.h"\n',
    "renderer/scene/table.h": '#include "heliograph/v1/scene.pb.h"\n',
    "renderer/schedule/worker.cpp": '#include "renderer/backend/embree/backend.h"\n',
    "server/calls/service.cpp": '#include "renderer/assets/load.h"\n',
    "renderer/frame/job.h": "#include <embree3/rtcore.h>\n",
    "server/app/frame.cpp": "#include <OpenImageIO/imageio.h>\n",
    "kernels/core/math.h": '#include "kernels/scene/ray.h"\n',
    "server/os/log.cpp": '#include "server/calls/rpc.h"\n',
    "server/convert/loose.cpp": '#include "server/loose.h"\n',
}


def run(files: dict[str, str], *flags: str) -> tuple[int, str]:
    with tempfile.TemporaryDirectory() as root:
        for name, text in files.items():
            path = pathlib.Path(root, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        done = subprocess.run(
            [sys.executable, LAYERS, *flags, root], capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout


def main() -> int:
    code, out = run(CLEAN)
    assert code == 0 and not out, out
    for name, text in BREACHES.items():
        code, out = run({**CLEAN, name: text})
        line = text.count("\n")
        assert code == 1 and out.startswith(f"{name}:{line}: "), (name, code, out)
        assert out.count("\n") == 1, out
    page = {"kernels/core/README.md": "# kernels/core\n\nMay include: no other room.\n"}
    code, out = run({**CLEAN, **page}, "--pages")
    assert code == 1 and "kernels/core" not in out, out
    wrong = "kernels/geometry/README.md: has no line 'May include: core, scene, material.'"
    assert wrong in out, out
    print(f"{len(BREACHES)} planted breaches found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
