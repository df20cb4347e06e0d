"""Ray queries a second from Python, on each workload. usage: rays.py [SCENES=build/bench/scenes]

Run with .venv/bin/python; bench/run makes the scenes.
"""

import os
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import common
import heliograph as hg
import numpy as np
from heliograph_scene import Heliograph

RAYS, ROUNDS = 1_000_000, 3


def main(scenes):
    rng = np.random.default_rng(0)
    for workload in ("W1", "W2", "W3", "W4", "W5"):
        doc = common.load_scene(os.path.join(scenes, workload))
        pose = np.array(doc["camera"]["to_world"])
        spread = np.tan(np.radians(doc["camera"]["fov_y_deg"]) / 2)
        local = np.column_stack([rng.uniform(-spread, spread, (RAYS, 2)), -np.ones(RAYS)])
        directions = (local @ pose[:3, :3].T).astype("f4")
        with hg.connect(arguments=["--threads", "2"]) as client:
            scene = Heliograph(client, doc).scene
            scene.cast_rays(pose[:3, 3], directions[:1000])
            for name, any_hit in (("closest, all columns", False), ("any hit", True)):
                best = np.inf
                for _ in range(ROUNDS):
                    start = time.perf_counter()
                    found = scene.cast_rays(pose[:3, 3], directions, any_hit=any_hit)
                    best = min(best, time.perf_counter() - start)
                hits = np.isfinite(found["t"]).mean()
                rate = RAYS / best / 1e6
                print(f"{workload} {name:22s} {rate:6.2f} million rays per second, {hits:.0%} hit")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "build/bench/scenes")
