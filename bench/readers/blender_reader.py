"""Models as Blender imports them: a reader of bench/models.py. Its Python needs bpy."""

import pathlib
import sys

import bpy
import numpy as np
from io_scene_gltf2.blender.imp.blender_gltf import BlenderGlTF

sys.path.append(str(pathlib.Path(__file__).parents[1]))
import model_facts  # noqa: E402

FOUND = []  # animations of the file
PREPARE = BlenderGlTF.pre_compute


def without_animations(gltf):
    """Removes animations, which would pose models that are compared at rest."""
    FOUND.extend(gltf.data.animations or [])
    gltf.data.animations = None
    PREPARE(gltf)


BlenderGlTF.pre_compute = staticmethod(without_animations)

AXES = {"forward_axis": "Y", "up_axis": "Z"}  # as they are
IMPORTERS = {
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path, validate_meshes=False, **AXES),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path, **AXES),
    ".stl": lambda path: bpy.ops.wm.stl_import(filepath=path, use_mesh_validate=False, **AXES),
    ".fbx": lambda path: bpy.ops.import_scene.fbx(filepath=path, use_anim=False),
    ".dae": lambda path: bpy.ops.wm.collada_import(filepath=path),
}


def read(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importer = IMPORTERS.get(pathlib.Path(path).suffix.lower())
    if importer is None:
        return {"refusal": "Blender has no importer for it"}
    FOUND.clear()
    importer(path)
    is_gltf = path.lower().endswith((".gltf", ".glb"))
    kinds = [thing.type for thing in bpy.data.objects]
    return {
        **surface(),
        "textures": sorted(pictures()),
        "joints": sum(len(thing.bones) for thing in bpy.data.armatures),
        "animations": len(FOUND) if is_gltf else None,
        "cameras": kinds.count("CAMERA"),
        "lights": kinds.count("LIGHT"),
    }


def surface():
    found = model_facts.Surface()
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        thing = instance.object
        if thing.type != "MESH":
            continue
        mesh = thing.to_mesh()
        mesh.calc_loop_triangles()
        positions = np.empty(3 * len(mesh.vertices))
        mesh.vertices.foreach_get("co", positions)
        indices = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", indices)
        world = np.array(instance.matrix_world)
        found.add(positions.reshape(-1, 3), indices.reshape(-1, 3), world)
        thing.to_mesh_clear()
    return found.facts()


def pictures():
    for image in bpy.data.images:
        width, height = image.size
        if image.source != "FILE" or width * height == 0:
            continue
        texels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(texels)
        yield model_facts.mean_colour(texels.reshape(height, width, image.channels))


if __name__ == "__main__":
    model_facts.serve(read)
