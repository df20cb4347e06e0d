"""Materials in Blender's Cycles. Run by materials_beside.py; side.py describes how."""

from __future__ import annotations

import os
import sys
from typing import Any

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import bpy
import materials
import numpy as np
import setting
import side
from mathutils import Matrix


def set_path_tracing(cycles: Any) -> None:
    """Sets Cycles to all paths of MAX_DEPTH edges, nothing clamped or left out."""
    bounces = setting.MAX_DEPTH - 2  # Cycles counts those after the first direct light
    for kind in ("max", "diffuse", "glossy", "transmission", "volume", "transparent_max"):
        setattr(cycles, f"{kind}_bounces", bounces)
    cycles.min_light_bounces = cycles.min_transparent_bounces = 1024  # no roulette
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.blur_glossy = cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.use_auto_tile = False


def set_output(scene: Any) -> None:
    """32-bit linear values as they are."""
    render = scene.render
    render.engine = "CYCLES"
    render.threads_mode, render.threads = "FIXED", 2
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    render.resolution_x = render.resolution_y = setting.SIZE
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGB"
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Raw"


def add_camera(scene: Any) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.type = "ORTHO"
    camera.ortho_scale = 2 * setting.HALF_VIEW
    add(scene, "camera", camera, setting.camera_pose())
    scene.camera = scene.objects["camera"]


def add(scene: Any, name: str, data: Any, pose: np.ndarray | None = None) -> Any:
    thing = bpy.data.objects.new(name, data)
    if pose is not None:
        thing.matrix_world = Matrix(pose.tolist())
    scene.collection.objects.link(thing)
    return thing


def mesh_of(name: str, ball: dict[str, np.ndarray]) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(ball["positions"].tolist(), [], ball["indices"].tolist())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(ball["indices"]), bool))
    corners = ball["indices"].ravel()
    mesh.uv_layers.new(name="uv").uv.foreach_set("vector", ball["uvs"][corners].ravel())
    mesh.normals_split_custom_set_from_vertices(ball["normals"].tolist())
    return mesh


def square(side: float) -> Any:
    mesh = bpy.data.meshes.new("square")
    h = side / 2
    mesh.from_pydata([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [], [(0, 1, 2, 3)])
    return mesh


def add_node(tree: Any, given: dict[str, Any]) -> Any:
    made = tree.nodes.new(given["node"])
    for name, value in given["properties"].items():
        setattr(made, name, value)
    for name, value in given["inputs"].items():
        made.inputs[name].default_value = value
    return made


def material_of(name: str, given: dict[str, Any]) -> Any:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    for socket, part in (("Surface", given), ("Volume", given.get("volume"))):
        if part:
            tree.links.new(add_node(tree, part).outputs[0], output.inputs[socket])
    return material


def glowing(radiance: float) -> Any:
    color = (1, 1, 1, 1)
    return material_of("glow", materials.node("Emission", Color=color, Strength=radiance))


class Studio:
    """Scene with everything that the lights need; each picture shows its own part."""

    def __init__(self) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        set_output(self.scene)
        set_path_tracing(self.scene.cycles)
        add_camera(self.scene)
        self.balls = [self.ball("ball", 1, False), self.ball("bubble", 1, True)]
        self.core = self.ball("core", setting.CORE, False)
        self.core.data.materials.append(None)
        self.lamps = {name: self.lamp(name) for name in setting.LAMPS}
        self.scene.world = bpy.data.worlds.new("world")
        self.scene.world.use_nodes = True

    def ball(self, name: str, radius: float, inwards: bool) -> Any:
        made = add(self.scene, name, mesh_of(name, setting.ball(radius, inwards)))
        made.data.materials.append(None)
        made.cycles.shadow_terminator_geometry_offset = 0
        return made

    def lamp(self, name: str) -> Any:
        lamp = add(self.scene, name, square(setting.LAMP_SIDE), setting.lamp_pose(name))
        lamp.data.materials.append(glowing(setting.LAMP_RADIANCE))
        return lamp

    def show(self, given: dict[str, Any], light: setting.Light) -> None:
        background = self.scene.world.node_tree.nodes["Background"]
        background.inputs["Color"].default_value = (light.dome,) * 3 + (1,)
        for name, lamp in self.lamps.items():
            lamp.hide_render = name != light.lamp
        for ball in self.balls:
            ball.hide_render = (ball.name == "bubble") != light.inside
            ball.data.materials[0] = material_of("shown", given)
        self.core.hide_render = light.core is None
        core = glowing(light.core or 0)
        core.cycles.emission_sampling = "NONE"
        self.core.data.materials[0] = core

    def picture(self, spp: int, seed: int) -> np.ndarray:
        path = f"/dev/shm/beside_{os.getpid()}.exr"
        self.scene.render.filepath = path
        self.scene.cycles.samples, self.scene.cycles.seed = spp, seed
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(path)
        values = np.empty(setting.SIZE**2 * 4, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
        os.remove(path)
        return values.reshape(setting.SIZE, setting.SIZE, 4)[::-1, :, :3]


def main() -> None:
    studio = Studio()

    def prepare(row: materials.Row, light: str) -> side.PictureOf:
        studio.show(row.cycles or {}, setting.LIGHTS[light])
        return studio.picture

    side.run("cycles", "cycles bpy " + bpy.app.version_string, prepare)


if __name__ == "__main__":
    main()
