"""Share of Embree's rays in the cost of each workload's paths: perf's samples of the daemon, those
in libembree against all. usage: embree_share.py [SCENES=build/bench/scenes]

Run with .venv/bin/python; needs perf, and bench/run makes the scenes.
"""

import os
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import common
import heliograph as hg
from heliograph_scene import Heliograph

SIZE, SPP = (1280, 720), 8


def shares(pid, work):
    """Library -> its share of the samples of a process while `work` is done."""
    with tempfile.NamedTemporaryFile() as file:
        perf = subprocess.Popen(
            ["perf", "record", "-q", "-F", "499", "-p", str(pid), "-o", file.name]
        )
        work()
        perf.terminate()
        perf.wait()
        text = subprocess.run(
            ["perf", "report", "-q", "-i", file.name, "--no-children", "--sort", "dso"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    lines = [line.split() for line in text.splitlines() if "%" in line]
    return {name: float(share.rstrip("%")) for share, name, *_ in lines}


def main(scenes):
    for workload in ("W1", "W2", "W3", "W4", "W5"):
        with hg.connect(arguments=["--threads", "2"]) as client:
            scene = Heliograph(client, common.load_scene(os.path.join(scenes, workload)))
            scene.render(SIZE, 1, 0)
            pid = client.connection.daemon._process.pid
            found = shares(pid, lambda scene=scene: scene.render(SIZE, SPP, 0))
            embree = sum(share for name, share in found.items() if name.startswith("libembree"))
            print(f"{workload}: Embree {embree:.0f} %; {100 / embree:.1f} times its rays")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "build/bench/scenes")
