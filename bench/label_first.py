"""Saving of accept=: core-seconds of client and daemon per accepted image of a bin-picking set,
labels first against shading every draw. usage: label_first.py [ACCEPTED] [WIDTHxHEIGHT] [SPP]

Bolts lie in a heap under a camera; a draw is accepted when every bolt shows enough pixels, as 20 %
of the draws do.
"""

import sys
import tempfile
import time
from pathlib import Path

import heliograph as hg
import heliograph.datasets as hd
import numpy as np

BOLT = Path(__file__).parents[1] / "examples/assets/bolt/bolt.glb"
SHARE, PROBES, REACH = 0.2, 200, 0.07  # acceptance; draws that find its threshold; metres


class Fewest(hd.Writer):
    """Keeps how many pixels the bolt that is hidden most has."""

    planes, labels = (), ("boxes",)

    def write(self, image):
        return int(image.frame.labels["visible"].min())

    def finish(self, records):
        self.found = [record for _, record in records]


def furnish(scene, size):
    with scene.edit() as edit:
        edit.sample_studio()
        bolts = edit.import_file(BOLT, category="bolt", count=12)
        lens = hg.Camera.from_fov(50, *size, degrees=True)
        cam = edit.entity(
            "cam", camera=lens, transform=hg.look_at((0, -2.5 * REACH, 3 * REACH), (0, 0, 0))
        )

    def heap(draw):
        middle = draw.rng.uniform((-1.2, -1.2, 0.5), (1.2, 1.2, 1.5), (len(bolts), 3)) * REACH
        draw.place(bolts, [hg.Pose(m, euler=draw.rng.uniform(0, 6.3, 3)) for m in middle])

    return cam, heap


def main(accepted, size, spp):
    with (
        hg.connect() as client,
        client.create_scene() as scene,
        tempfile.TemporaryDirectory() as out,
    ):
        cam, heap = furnish(scene, size)
        daemon = client.connection.daemon
        probe = Fewest(f"{out}/probe")
        hd.generate(scene, cam, heap, count=PROBES, seed=1, writer=probe)
        threshold = np.quantile(probe.found, 1 - SHARE)

        def run(name, count, **options):
            before = time.process_time() + daemon.cpu_seconds()
            writer = hd.Coco(f"{out}/{name}")
            done = hd.generate(scene, cam, heap, count=count, spp=spp, writer=writer, **options)
            return done, (time.process_time() + daemon.cpu_seconds() - before) / count

        every, shaded = run("every", accepted)
        print(f"a shaded image: {shaded:.3f} core-s, {accepted / every.seconds:.2f} a second")
        for labels in (["boxes"], True):
            done, cost = run(
                f"first-{labels}",
                accepted,
                accept=lambda seen: seen["visible"].min() > threshold,
                labels=labels,
                attempts=10_000,
            )
            draws = (accepted + done.rejected) / accepted
            print(
                f"labels first ({labels}): {cost:.3f} core-s an accepted image, {draws:.1f} draws "
                f"each: {shaded * draws / cost:.2f} times as cheap as shading them; at 20 % "
                f"acceptance {shaded / SHARE / (shaded + (cost - shaded) / draws / SHARE):.2f}"
            )


if __name__ == "__main__":
    given = sys.argv[1:]
    width, height = map(int, given[1].split("x")) if len(given) > 1 else (640, 480)
    main(int(given[0]) if given else 50, (width, height), int(given[2]) if len(given) > 2 else 64)
