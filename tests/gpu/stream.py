"""heliograph.torch on a GPU: a stream's tensors stay there and are those of the host, batches of
workers come pinned, also of workers spawned after this process used CUDA. Ends with 1 if not.

usage: stream.py   HELIOGRAPHD names the daemon
"""

import sys

import heliograph as hg
import numpy as np
import torch

PLANES = ["beauty", "depth", "instance"]
BALLS = [f"ball/{i}" for i in range(20)]


def furnish(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.15))
        poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
        edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
        lens = hg.Camera.from_fov(50, 256, 192, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.2)))


def scatter(draw):
    poses = np.tile(np.eye(4), (len(BALLS), 1, 1))
    poses[:, :2, 3] = draw.rng.uniform(-0.8, 0.8, (len(BALLS), 2))
    poses[:, 2, 3] = 0.15
    draw.place(BALLS, poses)


def frames(scene, **options):
    return hg.torch.Frames(scene, "cam", scatter, count=24, planes=PLANES, spp=8, **options)


def same(batch, other):
    return all(torch.equal(batch[plane].cpu(), other[plane].cpu()) for plane in PLANES)


def report(name, good):
    print(f"  {name:60} {'ok' if good else 'FAILED'}", flush=True)
    return good


def main():
    arguments = ["--backend", "cuda"]
    with hg.connect(arguments=arguments) as client, client.create_scene() as scene:
        furnish(scene)
        host = list(hg.torch.loader(frames(scene), 4))
        there = list(hg.torch.loader(frames(scene, device="cuda"), 4))
        on_gpu = all(batch[plane].is_cuda for batch in there for plane in PLANES)
        good = report("all planes of a stream stay on the GPU", on_gpu)
        equal = len(there) == len(host) == 6 and all(map(same, there, host))
        good &= report("and are those of the host", equal)
        spawned = {"num_workers": 2, "pin_memory": True, "multiprocessing_context": "spawn"}
        pinned = list(hg.torch.loader(frames(scene), 4, **spawned))
        is_pinned = all(batch[plane].is_pinned() for batch in pinned for plane in PLANES)
        equal = is_pinned and all(map(same, pinned, host))
        good &= report("batches of spawned workers are pinned, and the same", equal)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
