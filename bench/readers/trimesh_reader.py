"""Models as trimesh has them: a reader of bench/models.py. Its Python needs trimesh with pillow,
networkx, scipy, charset_normalizer and, for COLLADA, pycollada."""

import pathlib
import sys

import numpy as np
import trimesh

sys.path.append(str(pathlib.Path(__file__).parents[1]))
import model_facts  # noqa: E402

PICTURES = (  # occlusion is none of Heliograph's
    "image",
    "baseColorTexture",
    "metallicRoughnessTexture",
    "normalTexture",
    "emissiveTexture",
)
NONE = trimesh.visual.material.empty_material().image.tobytes()  # what it gives those without one


def read(path):
    scene = trimesh.load_scene(path, process=False, merge_primitives=False)
    turned = model_facts.Y_UP if pathlib.Path(path).suffix.lower() in (".gltf", ".glb") else None
    found, materials, pictures = model_facts.Surface(), {}, {}
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not hasattr(mesh, "faces"):
            continue
        world = pose if turned is None else turned @ pose
        found.add(mesh.vertices, mesh.faces, world)
        material = getattr(mesh.visual, "material", None)
        materials[id(material)] = material
    for material in materials.values():
        for key in PICTURES:
            picture = getattr(material, key, None)
            if picture is not None and picture.tobytes() != NONE:
                colours = picture if picture.mode != "P" else picture.convert("RGBA")
                pictures[id(picture)] = model_facts.mean_colour(np.asarray(colours))
    return {
        **found.facts(),
        "textures": sorted(pictures.values()),
        "cameras": None,
    }


if __name__ == "__main__":
    model_facts.serve(read)
