"""The pictures of the scenes DOME, MESH and FAT in Blender: what `heliograph dataset` is measured
beside. Two steps, in two environments:

    datasets_blender.py dump SCENE FILE.npz [COUNT=6]    with .venv: shapes, poses, views of draws
    datasets_blender.py run FILE.npz [SPP=64]            with a Python that has bpy and OpenEXR

`run` sets the poses, the camera, the materials with their textures and the lights of each draw,
renders 640x480 with depth, normals, object indices and, for MESH, vectors, into a multilayer EXR
for each image, and writes a PNG and the labels (blender_labels.py): one process, data kept between
pictures, draws made before, Blender's best case. Domes are turned at random. Prints seconds an
image, and those for labels among them; the first one, which builds everything, is apart.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

EDGES = 7  # of a path, as in datasets.py; Cycles counts bounces after the first direct light


def parameter(message, name, default):
    """A parameter of a material: its value or factor, its texture's id or 0, (2, 3) of uv."""
    found = getattr(message, name) if message.HasField(name) else None
    value = default
    if found is not None and found.HasField("value"):
        value = found.value
        value = [value.x, value.y, value.z] if hasattr(value, "x") else value
    use = found.texture if found is not None and found.HasField("texture") else None
    if use is None or not use.texture.id:
        return value, 0, None
    place = np.frombuffer(use.uv_transform.inline, "<f4") if use.HasField("uv_transform") else None
    return value, use.texture.id, np.eye(2, 3).ravel().tolist() if place is None else place.tolist()


def dump(name, path, count):
    import heliograph as hg
    import heliograph.datasets as hd
    from heliograph.client.edit import Edits
    from heliograph.datasets.draw import BasePoses
    from heliograph.datasets.scenes import make_scene

    pictures, make = [], Edits.texture

    def texture(self, name=None, image=None, **options):
        handle = make(self, name, image, **options)
        if isinstance(image, np.ndarray):
            pictures.append((handle, image, options.get("encoding", "srgb")))
        return handle

    Edits.texture = texture
    made = make_scene(name)
    with hg.connect() as client, client.create_scene() as scene:
        camera, randomizer = made.build(scene)
        entities = [e for e in scene.find("*") if getattr(e, "mesh", None) is not None]
        meshes = {e.mesh.id: e.mesh for e in entities}
        materials = list({e.material.id: None for e in entities})
        arrays = {}
        for i, mesh in enumerate(meshes.values()):
            arrays[f"positions{i}"], arrays[f"indices{i}"] = mesh.positions, mesh.indices
            for kind in ("normals", "uvs"):
                if (values := getattr(mesh, kind)) is not None:
                    arrays[f"{kind}{i}"] = values
        base, draws = BasePoses(scene), []
        for index in range(count):
            edit = scene.overlay()
            with edit:
                randomizer(hd.Draw(base, [camera], (0, index, 0), edit))
            branch = scene.branch()
            branch.apply(edit.transaction, None)
            here = [branch.handle(e.id) for e in entities]
            bound = dict(
                zip((e.material.id for e in entities), (e.material for e in here), strict=True)
            )
            lit = [e for e in branch.find("*") if getattr(e, "light", None) is not None]
            draws.append(
                {
                    "poses": [e.world_transform.tolist() for e in here],
                    "view": branch[camera.name].world_transform.tolist(),
                    "materials": [
                        {
                            "base_color": parameter(m, "base_color", [0.8] * 3),
                            "metallic": parameter(m, "metallic", 0.0),
                            "roughness": parameter(m, "roughness", 0.5),
                        }
                        for m in (bound[i]._read("material")[0].material for i in materials)
                    ],
                    "lights": [
                        {
                            "place": e.world_transform[:3, 3].tolist(),
                            "radius": e.light.radius,
                            "power": e.light.power,
                            "color": list(e.light.color),
                            "temperature": e.light.temperature,
                        }
                        for e in lit
                    ],
                }
            )
        for handle, picture, encoding in pictures:
            arrays[f"{encoding}{handle.id}"] = picture
        np.savez(
            path,
            scene=name,
            fov=made.fov,
            size=(made.width, made.height),
            domes=[str(p) for p in hd.bundled_domes()] if name != "mesh" else [],
            mesh_of=[list(meshes).index(e.mesh.id) for e in entities],
            material_of=[materials.index(e.material.id) for e in entities],
            draws=json.dumps(draws),
            **arrays,
        )


class Blender:
    """The scene of a dump."""

    def __init__(self, data, spp):
        import bpy
        from mathutils import Matrix

        self.bpy, self.matrix, self.data = bpy, Matrix, data
        self.draws = json.loads(str(data["draws"]))
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self._render_settings(spp)
        self._materials()
        self._objects()
        self._camera()
        self._world()
        self.lights = []

    def _render_settings(self, spp):
        render, cycles = self.scene.render, self.scene.cycles
        render.engine = "CYCLES"
        cycles.device, cycles.samples = "CPU", spp
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        # Takes the same paths of 7 edges as ours, whatever their kinds, as bench/peers does, and
        # nothing that biases the picture or that we do not have.
        for kind in ("max", "diffuse", "glossy", "transmission", "volume"):
            setattr(cycles, f"{kind}_bounces", EDGES - 2)
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0
        cycles.light_sampling_threshold = 0
        cycles.caustics_reflective = cycles.caustics_refractive = True
        render.resolution_x, render.resolution_y = self.data["size"].tolist()
        render.threads_mode, render.threads = "FIXED", 2
        render.use_persistent_data = True
        layer = self.scene.view_layers[0]
        layer.use_pass_z = layer.use_pass_normal = layer.use_pass_object_index = True
        layer.use_pass_vector = str(self.data["scene"]) == "mesh"

    def _materials(self):
        self.images = {}
        for key, texels in self.data.items():
            encoding, number = key.rstrip("0123456789"), key[len(key.rstrip("0123456789")) :]
            if encoding in ("srgb", "linear"):
                self.images[int(number)] = self._image(key, texels, encoding == "srgb")
        self.materials = []
        for i in range(int(self.data["material_of"].max()) + 1):
            material = self.bpy.data.materials.new(f"material{i}")
            material.use_nodes = True
            nodes, links = material.node_tree.nodes, material.node_tree.links
            for name in ("Base Color", "Metallic"):
                parameter = self.draws[0]["materials"][i][name.lower().replace(" ", "_")]
                if not parameter[1]:
                    continue
                texture, mapping = (nodes.new(f"ShaderNode{n}") for n in ("TexImage", "Mapping"))
                texture.name, mapping.name = f"{name} texture", f"{name} mapping"
                links.new(nodes.new("ShaderNodeTexCoord").outputs["UV"], mapping.inputs[0])
                links.new(mapping.outputs[0], texture.inputs[0])
                links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs[name])
            self.materials.append(material)

    def _image(self, name, texels, srgb):
        texels = texels if texels.ndim == 3 else texels[..., None]
        scale = np.iinfo(texels.dtype).max if texels.dtype.kind == "u" else 1
        rgba = np.ones((*texels.shape[:2], 4), np.float32)
        rgba[..., :3] = texels[::-1, :, :3] / scale
        image = self.bpy.data.images.new(name, texels.shape[1], texels.shape[0])
        image.colorspace_settings.name = "sRGB" if srgb else "Non-Color"
        image.pixels.foreach_set(rgba.ravel())
        image.update()
        image.pack()
        return image

    def _objects(self):
        bpy, data = self.bpy, self.data
        shapes = []
        for i in range(int(data["mesh_of"].max()) + 1):
            mesh = bpy.data.meshes.new(f"shape{i}")
            mesh.from_pydata(data[f"positions{i}"].tolist(), [], data[f"indices{i}"].tolist())
            mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
            if f"normals{i}" in data:
                mesh.normals_split_custom_set_from_vertices(data[f"normals{i}"].tolist())
            if f"uvs{i}" in data:
                corners = data[f"uvs{i}"][data[f"indices{i}"].ravel()]
                mesh.uv_layers.new().uv.foreach_set("vector", corners.ravel().tolist())
            mesh.materials.append(None)
            shapes.append(mesh)
        self.objects = []
        for i, shape in enumerate(data["mesh_of"].tolist()):
            thing = bpy.data.objects.new(f"object{i}", shapes[shape])
            thing.pass_index = i + 1
            thing.material_slots[0].link = "OBJECT"
            thing.material_slots[0].material = self.materials[data["material_of"][i]]
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
        self.domes = [bpy.data.images.load(path) for path in domes]
        self.dome = nodes.new("ShaderNodeTexEnvironment")
        self.mapping = nodes.new("ShaderNodeMapping")
        links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], self.mapping.inputs[0])
        links.new(self.mapping.outputs[0], self.dome.inputs["Vector"])
        links.new(self.dome.outputs["Color"], background.inputs["Color"])

    def draw(self, index):
        """The poses, materials and lights of a draw."""
        draw = self.draws[index]
        for thing, pose in zip(self.objects, draw["poses"], strict=True):
            thing.matrix_world = self.matrix(pose)
        self.camera.matrix_world = self.matrix(draw["view"])
        for material, values in zip(self.materials, draw["materials"], strict=True):
            self._look(material.node_tree.nodes, values)
        if len(self.data["domes"]):
            rng = np.random.default_rng(index)
            self.dome.image = self.domes[index % len(self.domes)]
            self.mapping.inputs["Rotation"].default_value[2] = float(rng.uniform(0, 2 * np.pi))
        for lamp in self.lights:
            self.bpy.data.objects.remove(lamp)
        self.lights = []
        for i, values in enumerate(draw["lights"]):
            light = self.bpy.data.lights.new(f"light{i}", "POINT")
            light.energy, light.color = values["power"], values["color"]
            light.use_temperature = values["temperature"] > 0
            light.temperature = values["temperature"]
            light.shadow_soft_size, light.use_soft_falloff = values["radius"], False
            lamp = self.bpy.data.objects.new(f"light{i}", light)
            lamp.location = values["place"]
            self.scene.collection.objects.link(lamp)
            self.lights.append(lamp)

    def _look(self, nodes, values):
        shader = nodes["Principled BSDF"].inputs
        shader["Base Color"].default_value = (*values["base_color"][0], 1)
        shader["Metallic"].default_value = values["metallic"][0]
        shader["Roughness"].default_value = values["roughness"][0]
        for name in ("Base Color", "Metallic"):
            _, number, place = values[name.lower().replace(" ", "_")]
            if not number:
                continue
            nodes[f"{name} texture"].image = self.images[number]
            (a, b, x), (c, _, y) = np.reshape(place, (2, 3)).tolist()
            scale, mapping = float(np.hypot(a, b)), nodes[f"{name} mapping"].inputs
            mapping["Scale"].default_value = (scale, scale, 1)
            mapping["Rotation"].default_value[2] = float(np.arctan2(c, a))
            mapping["Location"].default_value = (x, y, 0)

    def render(self, path):
        """PATH.exr with all passes, and PATH.png."""
        image = self.scene.render.image_settings
        self.scene.render.filepath = str(path)
        self._choose(image, "MULTI_LAYER_IMAGE", "OPEN_EXR_MULTILAYER", "32")
        self.bpy.ops.render.render(write_still=True)
        self._choose(image, "IMAGE", "PNG", "8")
        result = self.bpy.data.images["Render Result"]
        result.save_render(str(path.with_suffix(".png")), scene=self.scene)

    @staticmethod
    def _choose(image, kind, file_format, depth):
        if hasattr(image, "media_type"):
            image.media_type = kind
        image.file_format, image.color_depth = file_format, depth


def run(path, spp):
    from blender_labels import Labels

    start = time.perf_counter()
    with np.load(path) as file:
        data = dict(file)
    blender, labels = Blender(data, spp), Labels(data)
    took, labelling = [], []
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for index in range(len(blender.draws)):
            blender.draw(index)
            to = Path(folder, f"{index:06d}")
            blender.render(to)
            rendered = time.perf_counter()
            labels.write(to.with_suffix(".exr"), blender.draws[index], to.with_suffix(".json"))
            took.append(time.perf_counter() - start)
            labelling.append(time.perf_counter() - rendered)
            start = time.perf_counter()
        size = sum(file.stat().st_size for file in Path(folder).iterdir()) / len(took)
    rest = took[1:]
    print(
        f"blender {blender.bpy.app.version_string}, {data['scene']}, {spp} spp: first image "
        f"{took[0]:.1f} s, then {np.median(rest):.2f} s an image ({min(rest):.2f} to "
        f"{max(rest):.2f}, labels {np.median(labelling[1:]):.2f}), {60 / np.median(rest):.1f} "
        f"images per minute of {size / 1e6:.1f} MB"
    )


if __name__ == "__main__":
    if sys.argv[1] == "dump":
        dump(sys.argv[2], sys.argv[3], int(sys.argv[4]) if len(sys.argv) > 4 else 6)
    else:
        run(sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 64)
