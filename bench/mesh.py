"""The paper's MESH scene: W3's 1,000 random meshes under 6 lamps, all moved before each frame of
640x480 with 64 samples and every label.

usage: mesh.py heliograph|cycles [SCENES=build/bench/scenes]

Run heliograph with .venv/bin/python, cycles with build/bench/venv/bin/python; bench/run makes both.
Times are wall milliseconds, medians.
"""

import argparse
import os
import statistics
import sys
import time

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers"))
import common

SIZE, SPP, FRAMES = (640, 480), 64, 3
PLANES = ["beauty", "depth", "normal", "instance", "semantic", "position", "flow_backward"]


def moved(matrices, k):
    """Poses of all objects in frame k: pushed a little."""
    rng = np.random.default_rng(k)
    out = matrices.copy()
    out[:, :3, 3] += rng.uniform(-0.05, 0.05, (len(out), 3))
    return out


def milliseconds(call, repeats):
    taken = []
    for k in range(repeats + 1):  # the first one fills caches
        start = time.perf_counter()
        call(k + 1)
        taken.append((time.perf_counter() - start) * 1e3)
    return statistics.median(taken[1:])


def heliograph(doc):
    import heliograph as hg
    from heliograph_scene import Heliograph

    doc["all_move"] = True
    names = [o["name"] for o in doc["objects"] if not o["emission"]]
    matrices = np.array([o["to_world"] for o in doc["objects"] if not o["emission"]])
    with hg.connect(arguments=["--threads", "2"]) as client:
        scene = Heliograph(client, doc).scene
        lens = hg.Camera.from_fov(doc["camera"]["fov_y_deg"], *SIZE, axis="y", degrees=True)
        with scene.edit() as edit:
            edit.entity("eye", camera=lens, transform=doc["camera"]["to_world"])
        objects = [scene[name] for name in names]

        def edit(k):
            with scene.edit() as edit:
                edit.advance(1 / 30)
                edit.set_transforms(objects, moved(matrices, k))

        def look(k):
            scene.render("eye", size=(8, 8), planes=["depth"], labels=False, progress=False)

        def edit_and_look(k):
            edit(k)
            look(k)

        def frame(k):
            edit(k)
            scene.render("eye", spp=SPP, seed=k, planes=PLANES, labels=True, progress=False)

        print(f"edit of {len(names)} poses     {milliseconds(edit, 9):9.2f}")
        still = milliseconds(look, 9)
        print(f"8x8 of depth, unedited   {still:9.2f}")
        print(f"edit to 8x8 of depth     {milliseconds(edit_and_look, 9):9.2f}")
        print(f"frame with all labels    {milliseconds(frame, FRAMES):9.0f}")


def cycles(doc):
    from cycles_peer import Cycles

    peer = Cycles(doc, argparse.Namespace(threads=2))
    view = peer.sc.view_layers[0]
    for name in ("z", "normal", "object_index", "material_index", "position", "vector"):
        setattr(view, f"use_pass_{name}", True)
    objects = [peer.bpy.data.objects[o["name"]] for o in doc["objects"] if not o["emission"]]
    matrices = np.array([o["to_world"] for o in doc["objects"] if not o["emission"]])

    def edit(k):
        for number, (thing, matrix) in enumerate(zip(objects, moved(matrices, k), strict=True)):
            thing.matrix_world = peer.Matrix(matrix.tolist())
            thing.pass_index = number + 1
        peer.bpy.context.view_layer.update()

    def frame(k):
        edit(k)
        peer.render(SIZE, SPP, k)

    print(f"edit of {len(objects)} poses     {milliseconds(edit, 9):9.2f}")
    print(f"frame with its passes    {milliseconds(frame, FRAMES):9.0f}")


if __name__ == "__main__":
    folder = sys.argv[2] if len(sys.argv) > 2 else "build/bench/scenes"
    {"heliograph": heliograph, "cycles": cycles}[sys.argv[1]](
        common.load_scene(os.path.join(folder, "W3"))
    )
