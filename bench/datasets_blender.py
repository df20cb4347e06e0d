"""The pictures of the scenes DOME, MESH and FAT in Blender: what `heliograph dataset` is measured
beside. Two steps, in two environments:

    datasets_blender.py dump SCENE FILE.npz [COUNT=6]    with .venv: shapes, poses, views of draws
    datasets_blender.py run FILE.npz [SPP=64]            with a Python that has bpy

`run` moves all objects and the camera, draws materials and lights, and renders 640x480 with depth,
normals, object indices and, for MESH, vectors, into a multilayer EXR for each image: one process,
data kept between pictures, Blender's best case. Textures and labels are left out, in its favour.
Prints seconds an image; the first one, which builds everything, is apart.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np


def dump(name, path, count):
    import heliograph as hg
    import heliograph.datasets as hd
    from heliograph.datasets.draw import BasePoses
    from heliograph.datasets.scenes import make_scene

    made = make_scene(name)
    with hg.connect() as client, client.create_scene() as scene:
        camera, randomizer = made.build(scene)
        entities = [e for e in scene.find("*") if getattr(e, "mesh", None) is not None]
        meshes = {e.mesh.id: e.mesh for e in entities}
        arrays = {}
        for i, mesh in enumerate(meshes.values()):
            arrays[f"positions{i}"], arrays[f"indices{i}"] = mesh.positions, mesh.indices
        base, poses, views = BasePoses(scene), [], []
        for index in range(count):
            edit = scene.overlay()
            with edit:
                randomizer(hd.Draw(base, [camera], (0, index, 0), edit))
            branch = scene.branch()
            branch.apply(edit.transaction, None)
            poses.append([branch[e.name].world_transform for e in entities])
            views.append(branch[camera.name].world_transform)
        np.savez(
            path,
            scene=name,
            fov=made.fov,
            size=(made.width, made.height),
            domes=[str(p) for p in hd.bundled_domes()] if name != "mesh" else [],
            mesh_of=[list(meshes).index(e.mesh.id) for e in entities],
            poses=np.array(poses),
            views=np.array(views),
            **arrays,
        )


class Blender:
    """The scene of a dump."""

    def __init__(self, data, spp):
        import bpy
        from mathutils import Matrix

        self.bpy, self.matrix, self.data = bpy, Matrix, data
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self._render_settings(spp)
        self._objects()
        self._camera()
        self._world()
        self.lights = []

    def _render_settings(self, spp):
        render, cycles = self.scene.render, self.scene.cycles
        render.engine = "CYCLES"
        cycles.device, cycles.samples = "CPU", spp
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.max_bounces = 6
        render.resolution_x, render.resolution_y = self.data["size"].tolist()
        render.threads_mode, render.threads = "FIXED", 2
        render.use_persistent_data = True
        layer = self.scene.view_layers[0]
        layer.use_pass_z = layer.use_pass_normal = layer.use_pass_object_index = True
        layer.use_pass_vector = str(self.data["scene"]) == "mesh"
        image = render.image_settings
        if hasattr(image, "media_type"):
            image.media_type = "MULTI_LAYER_IMAGE"
        image.file_format = "OPEN_EXR_MULTILAYER"
        image.color_depth = "32"

    def _objects(self):
        bpy, data = self.bpy, self.data
        shapes = []
        for i in range(int(data["mesh_of"].max()) + 1):
            mesh = bpy.data.meshes.new(f"shape{i}")
            mesh.from_pydata(data[f"positions{i}"].tolist(), [], data[f"indices{i}"].tolist())
            mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
            shapes.append(mesh)
        self.materials = [bpy.data.materials.new(f"material{i}") for i in range(150)]
        for material in self.materials:
            material.use_nodes = True
        self.objects = []
        for i, shape in enumerate(data["mesh_of"].tolist()):
            thing = bpy.data.objects.new(f"object{i}", shapes[shape])
            thing.pass_index = i + 1
            thing.data.materials.clear()
            thing.data.materials.append(None)
            thing.material_slots[0].link = "OBJECT"
            thing.material_slots[0].material = self.materials[i % len(self.materials)]
            self.scene.collection.objects.link(thing)
            self.objects.append(thing)

    def _camera(self):
        lens = self.bpy.data.cameras.new("camera")
        lens.sensor_fit, lens.angle = "HORIZONTAL", float(self.data["fov"])
        self.camera = self.bpy.data.objects.new("camera", lens)
        self.scene.collection.objects.link(self.camera)
        self.scene.camera = self.camera

    def _world(self):
        bpy = self.bpy
        world = self.scene.world = bpy.data.worlds.new("world")
        world.use_nodes = True
        nodes, links = world.node_tree.nodes, world.node_tree.links
        background = nodes["Background"]
        background.inputs["Strength"].default_value = 1.0
        domes = self.data["domes"].tolist()
        if not domes:
            background.inputs["Color"].default_value = (0.02, 0.02, 0.02, 1)
            return
        self.images = [bpy.data.images.load(path) for path in domes]
        self.dome = nodes.new("ShaderNodeTexEnvironment")
        self.mapping = nodes.new("ShaderNodeMapping")
        links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], self.mapping.inputs[0])
        links.new(self.mapping.outputs[0], self.dome.inputs["Vector"])
        links.new(self.dome.outputs["Color"], background.inputs["Color"])

    def draw(self, index):
        """The poses of a draw; materials and lights of its own."""
        rng = np.random.default_rng(index)
        for thing, pose in zip(self.objects, self.data["poses"][index], strict=True):
            thing.matrix_world = self.matrix(pose.tolist())
        view = self.data["views"][index]
        self.camera.matrix_world = self.matrix(view.tolist())
        for material in self.materials:
            shader = material.node_tree.nodes["Principled BSDF"].inputs
            shader["Base Color"].default_value = (*rng.random(3).tolist(), 1)
            shader["Roughness"].default_value = float(rng.uniform(0.05, 0.95))
            shader["Metallic"].default_value = float(rng.random() < 0.3)
        if len(self.data["domes"]):
            self.dome.image = self.images[index % len(self.images)]
            self.mapping.inputs["Rotation"].default_value[2] = float(rng.uniform(0, 2 * np.pi))
            return
        for lamp in self.lights:
            self.bpy.data.objects.remove(lamp)
        self.lights = []
        for i in range(int(rng.integers(2, 7))):
            light = self.bpy.data.lights.new(f"light{i}", "POINT")
            light.energy = float(np.exp(rng.uniform(np.log(150), np.log(1500))))
            light.color = rng.uniform(0.3, 1, 3).tolist()
            light.shadow_soft_size = float(rng.uniform(0.1, 0.6))
            lamp = self.bpy.data.objects.new(f"light{i}", light)
            lamp.location = view[:3] @ [*rng.uniform(-2, 2, 2), rng.uniform(0.5, 4), 1]
            self.scene.collection.objects.link(lamp)
            self.lights.append(lamp)

    def render(self, path):
        self.scene.render.filepath = str(path)
        self.bpy.ops.render.render(write_still=True)


def run(path, spp):
    start = time.perf_counter()
    with np.load(path) as file:
        data = dict(file)
    blender = Blender(data, spp)
    took = []
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for index in range(len(data["views"])):
            blender.draw(index)
            blender.render(Path(folder, f"{index:06d}"))
            took.append(time.perf_counter() - start)
            start = time.perf_counter()
        sizes = [file.stat().st_size for file in Path(folder).iterdir()]
    rest = took[1:]
    print(
        f"blender {blender.bpy.app.version_string}, {data['scene']}, {spp} spp: first image "
        f"{took[0]:.1f} s, then {np.median(rest):.2f} s an image ({min(rest):.2f} to "
        f"{max(rest):.2f}), {60 / np.median(rest):.1f} images a minute; {len(sizes)} files of "
        f"{np.mean(sizes) / 1e6:.1f} MB"
    )


if __name__ == "__main__":
    if sys.argv[1] == "dump":
        dump(sys.argv[2], sys.argv[3], int(sys.argv[4]) if len(sys.argv) > 4 else 6)
    else:
        run(sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 64)
