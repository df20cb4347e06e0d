"""Models as assimp has them: a reader of bench/models.py. Its Python needs assimp_py 1.1.

It reports no nodes, cameras, lights and clips: these are not compared; poses are applied.
"""

import pathlib
import sys

import assimp_py
import numpy as np

sys.path.append(str(pathlib.Path(__file__).parents[1]))
import model_facts  # noqa: E402

FLAGS = assimp_py.Process_Triangulate | assimp_py.Process_PreTransformVertices
TURNED = (".dae", ".gltf", ".glb")  # to +Y up, by assimp


def read(path):
    scene = assimp_py.import_file(path, FLAGS)
    world = model_facts.Y_UP if pathlib.Path(path).suffix.lower() in TURNED else None
    found = model_facts.Surface()
    for mesh in scene.meshes:
        indices = np.frombuffer(mesh.indices, np.uint32)
        if len(indices) == 3 * mesh.num_faces:
            positions = np.frombuffer(mesh.vertices, np.float32).reshape(-1, 3)
            found.add(positions, indices.reshape(-1, 3), world)
    return found.facts()


if __name__ == "__main__":
    model_facts.serve(read)
