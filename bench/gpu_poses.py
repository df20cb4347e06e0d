"""Milliseconds from a PyTorch tensor of poses of all objects to a published snapshot, and from
there to a frame of 1 sample, on a GPU.

usage: bench/gpu_poses.py [BACKEND=cuda [OBJECTS...]]   Balls of 1,300 triangles in a grid, each
turned and moved each time; one edit after the other, then an edit and a frame in turn. HELIOGRAPHD
names the daemon; needs PyTorch with CUDA. With another backend poses and frames are numpy arrays.
"""

import statistics
import sys
import time

import heliograph as hg
import numpy as np
from gpu_overlay import furnish

WARM, MEASURED = 70, 40  # a scene keeps 64 revisions
OPTIONS = {"planes": ["depth", "instance"], "spp": 1, "size": (256, 256), "labels": False}


def poses_of(places, step):
    angle = 0.01 * step
    turned = np.array(places)
    turn = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    turned[:, :3, :3] = np.array(turn, dtype="f4")
    turned[:, 2, 3] += 0.01 * (step % 7)
    return turned


def measure(client, count, on_gpu):
    if on_gpu:
        import torch

        options = OPTIONS | {"device": "cuda"}
    else:
        options = OPTIONS
    edits, first, frames, inside = [], [], [], []
    with client.create_scene() as scene:
        balls = furnish(scene, count)
        places = np.tile(np.eye(4, dtype="f4"), (count, 1, 1))
        side = round(count ** (1 / 3)) + 1
        places[:, :3, 3] = np.stack(np.unravel_index(np.arange(count), (side,) * 3), -1) - side / 2
        for i in range(WARM + 2 * MEASURED):
            poses = poses_of(places, i)
            if on_gpu:
                poses = torch.from_numpy(poses).cuda()
                torch.cuda.synchronize()
            start = time.perf_counter()
            with scene.edit() as edit:
                edit.set_transforms(balls, poses)
            published = time.perf_counter()
            if i < WARM:
                continue
            if i < WARM + MEASURED:
                edits.append(published - start)
                continue
            frame = scene.render("camera", seed=i, **options)
            if on_gpu:
                frame.torch("depth")
            first.append(published - start)
            frames.append(time.perf_counter() - published)
            inside.append(frame.render_seconds)
    median = [1e3 * statistics.median(each) for each in (edits, first, frames, inside)]
    print(
        f"{count:,} objects: an edit {median[0]:.2f} ms (best {1e3 * min(edits):.2f}), after a "
        f"frame {median[1]:.2f}; then a frame {median[2]:.2f} ms, {median[3]:.2f} in the renderer",
        flush=True,
    )


def main(backend, counts):
    with hg.connect(arguments=["--backend", backend]) as client:
        for count in counts:
            measure(client, count, backend == "cuda")


if __name__ == "__main__":
    main(
        sys.argv[1] if len(sys.argv) > 1 else "cuda",
        [int(each) for each in sys.argv[2:]] or [1000, 10_000, 100_000],
    )
