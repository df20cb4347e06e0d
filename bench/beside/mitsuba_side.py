"""Materials in Mitsuba 3. Run by materials_beside.py; side.py describes how."""

from __future__ import annotations

import os
import sys
import tempfile
from typing import Any

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import materials
import numpy as np
import setting
import side


def choose_variant() -> Any:
    """The module, compiled by LLVM where there is one."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    try:
        import drjit as dr

        dr.eval(mi.Float(1) + 1)
        dr.set_thread_count(2)
    except (RuntimeError, ImportError):
        mi.set_variant("scalar_rgb")
    return mi


class Balls:
    """Writes the meshes that scenes name."""

    def __init__(self, mi: Any, folder: str) -> None:
        self.mi, self.folder = mi, folder

    def path(self, radius: float, inwards: bool) -> str:
        path = os.path.join(self.folder, f"ball_{radius}_{inwards}.ply")
        if not os.path.exists(path):
            self.write(path, setting.ball(radius, inwards))
        return path

    def write(self, path: str, ball: dict[str, np.ndarray]) -> None:
        mesh = self.mi.Mesh(
            "ball",
            len(ball["positions"]),
            len(ball["indices"]),
            has_vertex_normals=True,
            has_vertex_texcoords=True,
        )
        parameters = self.mi.traverse(mesh)
        for key, name in (
            ("vertex_positions", "positions"),
            ("vertex_normals", "normals"),
            ("vertex_texcoords", "uvs"),
            ("faces", "indices"),
        ):
            parameters[key] = ball[name].ravel()
        parameters.update()
        mesh.write_ply(path)


BLACK = {"type": "diffuse", "reflectance": 0.0}


def sensor(mi: Any) -> dict[str, Any]:
    pose = setting.camera_pose() @ np.diag([-setting.HALF_VIEW, setting.HALF_VIEW, -1, 1])
    return {
        "type": "orthographic",
        "to_world": mi.ScalarTransform4f(pose),
        "sampler": {"type": "independent"},
        "film": {
            "type": "hdrfilm",
            "width": setting.SIZE,
            "height": setting.SIZE,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
    }


def emitter(radiance: float) -> dict[str, Any]:
    return {"type": "area", "radiance": {"type": "rgb", "value": radiance}}


def lights(mi: Any, balls: Balls, light: setting.Light, scale: float) -> dict[str, Any]:
    scene: dict[str, Any] = {}
    if light.dome:
        scene["dome"] = {"type": "constant", "radiance": {"type": "rgb", "value": light.dome}}
    if light.lamp:
        pose = setting.lamp_pose(light.lamp) @ np.diag([setting.LAMP_SIDE / 2] * 2 + [1, 1])
        scene["lamp"] = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(pose),
            "bsdf": BLACK,
            "emitter": emitter(setting.LAMP_RADIANCE),
        }
    if light.core is not None:
        scene["core"] = body(balls.path(setting.CORE, False), BLACK)
        if light.core:
            scene["core"]["emitter"] = emitter(light.core * scale)
    return scene


def body(path: str, bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "ply", "filename": path, "bsdf": bsdf}


def scene_of(mi: Any, balls: Balls, row: materials.Row, light: str) -> Any:
    given = dict(row.mitsuba or {})
    setup = setting.LIGHTS[light]
    interior = given.pop("interior", None)
    ball = body(balls.path(1, setup.inside), given)
    if interior:
        ball["interior"] = interior
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {
                "type": "volpath" if interior else "path",
                "max_depth": setting.MAX_DEPTH,
                "rr_depth": 100000,
            },
            "sensor": sensor(mi),
            "ball": ball,
            **lights(mi, balls, setup, materials.core_scale(row, light)),
        }
    )


def main() -> None:
    mi = choose_variant()
    with tempfile.TemporaryDirectory() as folder:
        balls = Balls(mi, folder)

        def prepare(row: materials.Row, light: str) -> side.PictureOf:
            scene = scene_of(mi, balls, row, light)
            return lambda spp, seed: np.array(mi.render(scene, spp=spp, seed=seed))

        side.run("mitsuba", f"mitsuba {mi.__version__} {mi.variant()}", prepare)


if __name__ == "__main__":
    main()
