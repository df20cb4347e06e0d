"""Stands for a training program: pictures and labels from the daemon beside it, by its socket.

usage: train.py [ADDRESS [BATCHES]]
"""

import sys

import heliograph as hg

ADDRESS = "unix:///run/heliograph/heliograph.sock"


def main(address: str = ADDRESS, batches: int = 10) -> None:
    with hg.connect(address) as client, client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
            edit.entity("ball", mesh=mesh, transform=hg.Pose((0, 0, 0.5)), label="auto")
            lens = hg.Camera.from_fov(50, 128, 128, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
        for batch in range(batches):
            frame = scene.render("cam", spp=4, seed=batch, planes=["beauty", "depth"])
            picture = frame["beauty"]
            print(f"batch {batch}: {picture.shape}, mean {picture.mean():.4f}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
