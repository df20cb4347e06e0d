"""Memory of 100 million instanced triangles: 100,000 entities of one mesh of 1,000.
usage: .venv/bin/python bench/instances.py [ENTITIES=100000]"""

import os
import sys
import time

import heliograph as hg
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import usage

MESH_TRIANGLES = 1000


def terrain():
    """A bumpy sheet of 1,000 triangles."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 26), np.linspace(-0.5, 0.5, 21))
    positions = np.stack([x, y, 0.1 * np.sin(9 * x) * np.cos(7 * y)], -1).reshape(-1, 3)
    corner = (np.arange(20)[:, None] * 26 + np.arange(25)).ravel()
    quads = np.stack([corner, corner + 1, corner + 27, corner, corner + 27, corner + 26], -1)
    return positions.astype("f4"), quads.reshape(-1, 3).astype("u4")


def main(count):
    tree = usage.Tree()
    rng = np.random.default_rng(1)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = rng.uniform(-100, 100, (count, 3))
    positions, indices = terrain()
    with hg.connect(arguments=["--threads", "2"]) as client, client.create_scene() as scene:
        start = time.perf_counter()
        with scene.edit() as edit:
            mesh = edit.mesh("sheet", positions=positions, indices=indices)
            edit.instances("sheets", mesh=mesh, transforms=poses)
            edit.dome(color=(1, 1, 1))
            lens = hg.Camera.from_fov(60, 640, 480, degrees=True)
            edit.entity("eye", camera=lens, transform=hg.look_at((0, 0, 0), (1, 0, 0)))
        edited = time.perf_counter()
        options = {"planes": ["beauty", "instance"], "labels": {"boxes": True, "max_rows": count}}
        frame = scene.render("eye", spp=1, progress=False, **options)
        rendered = time.perf_counter()
        seen = len(np.unique(frame["instance"]))
        print(f"{count} instances, {count * MESH_TRIANGLES / 1e6:.0f} M triangles, {seen} seen")
        print(f"edit {edited - start:.2f} s, first frame {rendered - edited:.2f} s")
        print(f"peak memory of client and daemon {tree.usage()[1]:.0f} MB")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
