"""Images per minute of the scenes DOME, MESH and FAT: 640x480, 64 spp, all labels, on two threads.

usage: datasets.py [IMAGES=4] [SCENE...]

Drawing, rendering, encoding and writing count, the scene's building does not. "idle" is what two
cores that nothing else uses would make: 120 s over the processor seconds of an image, of daemon and
client. Run with .venv/bin/python.
"""

import resource
import sys
import tempfile
import time

import heliograph as hg
import heliograph.datasets as hd

PLANES = ("depth", "normal", "instance", "semantic")
FLOW = ("flow_backward", "flow_backward_valid")
DEPTH = 7  # edges of a path, as in datasets_blender.py
JOBS = ("64 spp and all labels", "labels alone", "columns alone")


def writer_of(job, name, out):
    planes = (*PLANES, *(FLOW if name == "mesh" else ()))
    if job == JOBS[0]:
        return hd.Exr(out, planes=("beauty", *planes), picture="png")
    return hd.Exr(out, planes=planes) if job == JOBS[1] else hd.Parquet(out)


def processor_seconds():
    """CPU seconds of this process and the daemons that it has ended."""
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def measure(name, job, count):
    """(seconds, processor seconds) of so many images; one more is made before, which is not
    counted in the former, and a run of it alone is taken off the latter."""
    used = []
    for images in (1, count + 1):
        before = processor_seconds()
        with tempfile.TemporaryDirectory() as out:
            with hg.connect(arguments=("--threads", "2")) as client, client.create_scene() as scene:
                made = hd.make_scene(name)
                camera, randomizer = made.build(scene)
                common = {"count": images, "writer": writer_of(job, name, out), "spp": 64}
                common |= {"max_depth": DEPTH, "progress": False, **made.options}
                hd.generate(scene, camera, randomizer, indices=[0], **common)
                start = time.perf_counter()
                hd.generate(scene, camera, randomizer, **common)
                seconds = time.perf_counter() - start
        used.append(processor_seconds() - before)
    return seconds, used[1] - used[0]


def main(count, names):
    print(f"{'':6s}{'':24s}{'images per minute':>17s}{'idle':>9s}{'s an image':>12s}")
    for name in names:
        for job in JOBS:
            images = count if job == JOBS[0] else 8 * count
            seconds, used = measure(name, job, images)
            each = used / images
            rate = 60 * images / seconds
            print(f"{name:6s}{job:24s}{rate:17.1f}{120 / each:9.1f}{each:12.2f}", flush=True)


if __name__ == "__main__":
    given = sys.argv[1:]
    images = int(given.pop(0)) if given and given[0].isdigit() else 4
    main(images, given or ["dome", "mesh", "fat"])
