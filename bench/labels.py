"""Frames per second of label-only jobs: 640x480 of W2. usage: labels.py [SCENES=build/bench/scenes]

Run with .venv/bin/python; bench/run makes the scenes.
"""

import os
import statistics
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import common
import heliograph as hg
from heliograph_scene import Heliograph

FRAMES = 20
COLUMNS = {"boxes": True, "amodal": True, "amodal_masks": True, "keypoints": True}
JOBS = {
    "instance, depth, normal, visible boxes": (["instance", "depth", "normal"], ["boxes"]),
    "the same, all columns, amodal masks": (["instance", "depth", "normal"], COLUMNS),
}


def main(scenes):
    doc = common.load_scene(os.path.join(scenes, "W2"))
    with hg.connect(arguments=["--threads", "2"]) as client:
        peer = Heliograph(client, doc)
        lens = hg.Camera.from_fov(doc["camera"]["fov_y_deg"], 640, 480, axis="y", degrees=True)
        with peer.scene.edit() as edit:
            camera = edit.entity("labels", camera=lens, transform=doc["camera"]["to_world"])
        for name, (planes, labels) in JOBS.items():
            taken = []
            for _ in range(FRAMES + 1):
                start = time.perf_counter()
                frame = peer.scene.render(camera, planes=planes, labels=labels, progress=False)
                taken.append(time.perf_counter() - start)
            rate = 1 / statistics.median(taken[1:])
            rows = len(frame.labels["label"])
            print(f"{name:42s} {rate:6.1f} frames per second, {rows} instances")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "build/bench/scenes")
