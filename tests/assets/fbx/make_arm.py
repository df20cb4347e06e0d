"""Makes arm.fbx and arm.glb: a textured arm with a skin, a shape key and a clip, a metal box, a
lamp and a camera, as Blender writes them. Run with a Python that has bpy: make_arm.py FOLDER"""

import math
import pathlib
import sys

import bpy

out = pathlib.Path(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = 24
scene.frame_start, scene.frame_end = 0, 24


def material(name, color, metallic, roughness):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*color, 1)
    shader.inputs["Metallic"].default_value = metallic
    shader.inputs["Roughness"].default_value = roughness
    return made


image = bpy.data.images.new("checker", 8, 8)
image.pixels = [c for y in range(8) for x in range(8) for c in (x / 7, y / 7, 0.2, 1)]
image.filepath_raw = str(out / "checker.png")
image.file_format = "PNG"
image.save()
skin = material("skin", (0.8, 0.8, 0.8), 0.0, 0.5)
texture = skin.node_tree.nodes.new("ShaderNodeTexImage")
texture.image = image
skin.node_tree.links.new(
    texture.outputs["Color"], skin.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
)

# A bar along +Z of 2 x 0.4 x 0.4 m with rings of vertices; the upper half follows the second bone.
bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.2, depth=2, location=(0, 0, 1))
bar = bpy.context.object
bar.name = bar.data.name = "bar"
bpy.ops.object.mode_set(mode="EDIT")
bpy.ops.mesh.subdivide(number_cuts=3)
bpy.ops.object.mode_set(mode="OBJECT")
bar.data.materials.append(skin)
bar.data.materials.append(material("tip", (0.1, 0.5, 0.9), 0.0, 0.3))
for polygon in bar.data.polygons:
    polygon.material_index = int(polygon.center.z > 0.9)
bar.shape_key_add(name="Basis")
wide = bar.shape_key_add(name="wide")
for point in wide.data:
    if point.co.z < -0.5:
        point.co.x *= 1.5
wide.value = 0.25
bpy.ops.object.armature_add(location=(0, 0, 0))
bones = bpy.context.object
bones.name = bones.data.name = "bones"
bpy.ops.object.mode_set(mode="EDIT")
lower = bones.data.edit_bones[0]
lower.name, lower.head, lower.tail = "lower", (0, 0, 0), (0, 0, 1)
upper = bones.data.edit_bones.new("upper")
upper.head, upper.tail, upper.parent = (0, 0, 1), (0, 0, 2), lower
bpy.ops.object.mode_set(mode="OBJECT")
for name, above in (("lower", False), ("upper", True)):
    group = bar.vertex_groups.new(name=name)
    # the bar's vertices are about its middle, 1 m up
    group.add([v.index for v in bar.data.vertices if (v.co.z > 0) == above], 1, "REPLACE")
bar.parent = bones
bar.modifiers.new("skin", "ARMATURE").object = bones
pose = bones.pose.bones["upper"]
pose.rotation_mode = "XYZ"
for frame, angle in ((0, 0), (24, math.pi / 2)):
    pose.rotation_euler = (angle, 0, 0)
    pose.keyframe_insert("rotation_euler", frame=frame)
bones.animation_data.action.name = "bend"

bpy.ops.mesh.primitive_cube_add(size=0.5, location=(1, 0.5, 0.25), rotation=(0, 0, 0.5))
box = bpy.context.object
box.name = box.data.name = "box"
box.scale = (1, 2, 0.5)
box.data.materials.append(material("metal", (0.9, 0.7, 0.3), 1.0, 0.2))

light = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
light.location = (2, -2, 3)
light.data.energy = 1000
scene.collection.objects.link(light)
camera = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
camera.location, camera.rotation_euler = (4, -4, 2.5), (math.radians(70), 0, math.radians(45))
scene.collection.objects.link(camera)
scene.camera = camera
scene.frame_set(0)
bpy.ops.export_scene.fbx(
    filepath=str(out / "arm.fbx"), path_mode="COPY", embed_textures=True, add_leaf_bones=False
)
bpy.ops.export_scene.gltf(filepath=str(out / "arm.glb"), export_cameras=True, export_lights=True)
