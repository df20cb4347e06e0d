"""Our pictures against Mitsuba's converged ones.

usage: agreement.py [WORK=build/bench] [SPP=1024]
Run with .venv/bin/python; bench/run makes scenes and references. W1 as it is, the others with
Lambert in place of principled materials. z of a pixel: difference over its standard error, by the
spread of independent pictures on both sides; noise alone gives |z| > 2 in 4.6 % of the values and
> 3 in 0.27 % (somewhat more where few pictures estimate a heavy-tailed error). FLAT=1 compares
without interpolated normals, which Mitsuba and we treat differently at silhouettes; make those
references, W3_lambert_flat.npz and so on, with mitsuba_peer.py --flat --lambert.
"""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import common
import heliograph as hg
import numpy as np
from heliograph_scene import Heliograph

CHUNKS = 32


def picture(peer, spp):
    """Mean over CHUNKS pictures, and the variance of that mean."""
    images = [
        peer.image(common.QUALITY, max(1, spp // CHUNKS), 1 + k).astype("f8") for k in range(CHUNKS)
    ]
    return np.mean(images, axis=0), np.var(images, axis=0, ddof=1) / CHUNKS


def main(work, spp):
    flat = "_flat" if os.environ.get("FLAT") else ""
    print("workload  mean ours  Mitsuba's  difference  its error   |z|>2    |z|>3   median z")
    for workload in os.environ.get("WORKLOADS", "W1 W2 W3 W4 W5").split():
        variant = ("" if workload == "W1" else "_lambert") + flat
        path = os.path.join(work, "refs", workload + variant + ".npz")
        if not os.path.exists(path):
            print(f"{workload:8s}  no reference {path}")
            continue
        reference = np.load(path)
        doc = common.load_scene(os.path.join(work, "scenes", workload), lambert=True)
        doc["flat"] = bool(flat)
        with hg.connect(arguments=["--threads", "2"]) as client:
            mean, variance = picture(Heliograph(client, doc), spp)
        both = variance + reference["variance"]
        z = ((mean - reference["mean"]) / np.sqrt(np.maximum(both, 1e-12))).ravel()
        ours, theirs = mean.mean(), reference["mean"].mean()
        error = np.sqrt(both.sum()) / both.size / theirs
        print(
            f"{workload:8s} {ours:9.5f}  {theirs:9.5f}  {ours / theirs - 1:+10.3%}  {error:9.3%}"
            f"  {np.mean(abs(z) > 2):6.2%}  {np.mean(abs(z) > 3):6.2%}  {np.median(z):+8.3f}",
            flush=True,
        )
        np.savez(os.path.join(work, f"ours_{workload}{variant}.npz"), mean=mean, variance=variance)


if __name__ == "__main__":
    main(
        sys.argv[1] if len(sys.argv) > 1 else "build/bench",
        int(sys.argv[2]) if len(sys.argv) > 2 else 1024,
    )
