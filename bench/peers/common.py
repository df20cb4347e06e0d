"""Shared by all peers: neutral scene reader, timing protocol, error metrics. numpy only."""

import argparse
import json
import os
import resource
import time

import numpy as np

FULL, SMALL, QUALITY = (1280, 720), (256, 256), (192, 108)
CHUNK = 64  # samples per pixel of one picture of a reference


def load_scene(folder, lambert=False):
    with open(os.path.join(folder, "scene.json")) as file:
        doc = json.load(file)
    doc["dir"] = folder
    if lambert:
        for material in doc["materials"].values():
            if material["type"] == "principled":
                material["type"] = "diffuse"
    return doc


def read_ply(path):
    """Reads the layout that make_scenes.py writes: x y z nx ny nz u v float32, uchar + 3 int32
    faces."""
    with open(path, "rb") as file:
        header = list(iter(file.readline, b"end_header\n"))
        vertices, faces = (int(line.split()[2]) for line in header if line.startswith(b"element"))
        v = np.fromfile(file, "<f4", vertices * 8).reshape(-1, 8)
        v = [np.ascontiguousarray(v[:, part]) for part in (slice(3), slice(3, 6), slice(6, 8))]
        face = np.dtype([("n", "u1"), ("i", "<i4", 3)])
        return *v, np.ascontiguousarray(np.fromfile(file, face, faces)["i"])


def edited_matrix(doc, k):
    """World matrix of the edited object in frame k."""
    edited = next(o for o in doc["objects"] if o["name"] == doc["edit"]["object"])
    matrix = np.array(edited["to_world"])
    matrix[:3, 3] += np.array(doc["edit"]["step"]) * (k % 7)
    return matrix


def errors(image, reference):
    squared = (image - reference) ** 2
    relative = (squared / (reference**2 + 1e-2)).mean(-1).ravel()
    kept = np.sort(relative)[: int(len(relative) * 0.999)]
    return {
        "rmse": float(np.sqrt(squared.mean())),
        "relmse": float(relative.mean()),
        "relmse_trim": float(kept.mean()),
    }


def own_process():
    """(CPU seconds so far, peak memory in MB) of this process."""
    return time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def parse(extra):
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("task", choices=["cold", "full", "quality", "reference"])
    parser.add_argument("--spp", type=int, default=2)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--edits", type=int, default=6)
    parser.add_argument("--lambert", action="store_true", help="principled materials as diffuse")
    parser.add_argument("--reference", help="quality: compare with this .npz; reference: write it")
    extra(parser)
    return parser.parse_args()


def measure_full(peer, doc, args, timed):
    """Unedited frames, edited frames, then pictures of full size."""
    result = {"spp": args.spp}
    result["warm_frame"] = [timed(lambda: peer.render(SMALL, 1, k))[1] for k in range(args.edits)]

    def edit(k):
        peer.edit(doc["edit"]["object"], edited_matrix(doc, k))
        peer.render(SMALL, 1, k)

    edits = [timed(lambda: edit(k + 1))[1] for k in range(args.edits + 2)]
    result["edit_first"], result["edit_frame"] = edits[0], edits[2:]  # two fill any caches
    result["render"] = [
        timed(lambda: peer.render(FULL, args.spp, k))[1] for k in range(args.repeats)
    ]
    return result


def write_reference(peer, args):
    """Mean and variance of the mean over pictures of CHUNK samples each; saved as it grows."""
    total = squares = 0.0
    chunks = max(2, args.spp // CHUNK)
    for n in range(1, chunks + 1):
        image = peer.image(QUALITY, CHUNK, 1000 + n).astype(np.float64)
        total, squares = total + image, squares + image**2
        if n % 8 == 0 or n == chunks:
            mean = total / n
            variance = np.maximum(squares / n - mean**2, 0) / (n - 1)
            with open(args.reference + ".part", "wb") as file:
                np.savez(file, mean=mean, variance=variance, spp=n * CHUNK)
    os.replace(args.reference + ".part", args.reference)
    return {"spp": chunks * CHUNK, "mean": mean.mean((0, 1)).tolist()}


def measure_quality(peer, args, timed):
    reference = np.load(args.reference)["mean"]
    peer.image(QUALITY, args.spp, 0)
    image, seconds = timed(lambda: peer.image(QUALITY, args.spp, 7))
    return {"spp": args.spp, "qual": seconds, **errors(image, reference)}


def main(peer_class, extra=lambda parser: None, usage=own_process, started=None):
    """Runs one task and prints one line "RESULT {json}". Times are [wall s, CPU s of all threads
    and processes]: compare the latter on a shared machine. started: (wall, CPU) when a peer that
    loads before it is constructed began to."""
    args = parse(extra)

    def timed(call, since=None):
        wall, cpu = since or (time.perf_counter(), usage()[0])
        value = call()
        return value, [time.perf_counter() - wall, usage()[0] - cpu]

    result = {}
    doc = load_scene(args.scene, args.lambert)
    peer, result["load"] = timed(lambda: peer_class(doc, args), started)
    _, result["first_frame"] = timed(lambda: peer.render(SMALL, 1, 0))
    result["first_image_monotonic"], result["cpu_to_first_image"] = time.monotonic(), usage()[0]
    result["version"] = peer.version
    if args.task == "full":
        result |= measure_full(peer, doc, args, timed)
    if args.task == "quality":
        result |= measure_quality(peer, args, timed)
    if args.task == "reference":
        result |= write_reference(peer, args)
    result["peak_rss_mb"] = usage()[1]
    print("RESULT " + json.dumps(result), flush=True)
    os._exit(0)  # the teardown belongs to no figure
