"""The golden scenes: small, each with many ways light can go. Used by test_images.py and renew.py.

A scene function fills an edit and returns the options of its render.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import heliograph as hg
import numpy as np

SIZE = (64, 48)


def _camera(edit: Any, eye: tuple, target: tuple, fov: float) -> None:
    camera = hg.Camera.from_fov(fov, *SIZE, degrees=True)
    edit.entity("camera", camera=camera, transform=hg.look_at(eye, target, (0, 0, 1)))


def _square(edit: Any, name: str, material: Any, matrix: list, **more: Any) -> None:
    edit.entity(name, mesh="square", material=material, transform=np.array(matrix, float), **more)


def cornell(edit: Any) -> dict[str, Any]:
    """Colour bleeding, an area light, glass and rough metal; depth 8."""
    edit.mesh("square", **hg.shapes.plane(2))
    edit.mesh("ball", **hg.shapes.sphere(0.35, 48))
    for name, color in (
        ("white", 0.73),
        ("red", (0.63, 0.06, 0.05)),
        ("green", (0.14, 0.45, 0.09)),
    ):
        edit.material(name, base_color=color, specular=0)
    edit.material("black", base_color=0, specular=0)
    _square(edit, "floor", "white", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    _square(edit, "ceiling", "white", [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]])
    _square(edit, "back", "white", [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 1], [0, 0, 0, 1]])
    _square(edit, "left", "red", [[0, 0, 1, -1], [0, 1, 0, 0], [-1, 0, 0, 1], [0, 0, 0, 1]])
    _square(edit, "right", "green", [[0, 0, -1, 1], [0, 1, 0, 0], [1, 0, 0, 1], [0, 0, 0, 1]])
    lamp = [[0.25, 0, 0, 0], [0, -0.25, 0, 0], [0, 0, -0.25, 1.99], [0, 0, 0, 1]]
    _square(edit, "lamp", "black", lamp, light=hg.Light(radiance=1, color=(17, 12, 8)))
    edit.material("glass", **hg.materials.glass)
    edit.material("metal", base_color=(0.9, 0.8, 0.6), metallic=1, roughness=0.45)
    edit.entity("glass_ball", mesh="ball", material="glass", transform=hg.Pose((-0.4, -0.3, 0.35)))
    edit.entity("metal_ball", mesh="ball", material="metal", transform=hg.Pose((0.4, 0.3, 0.36)))
    _camera(edit, (0, -3.9, 1), (0, 0, 1), 40)
    return {"max_depth": 8}


def materials(edit: Any) -> dict[str, Any]:
    """Roughness, metal, coat, rough glass and alpha under an HDR dome with a small sun."""
    sky = np.full((16, 32, 3), (0.35, 0.5, 0.8), "f4")
    sky[8:] = (0.2, 0.18, 0.15)
    sky[3, 6] = (300, 270, 220)
    edit.dome(sky)
    edit.mesh("ball", **hg.shapes.sphere(0.45, 48))
    edit.mesh("square", **hg.shapes.plane(12))
    edit.material("earth", base_color=(0.4, 0.38, 0.35), roughness=0.7)
    edit.entity("ground", mesh="square", material="earth")
    looks = [
        {"base_color": (0.7, 0.2, 0.1), "roughness": 0.1},
        {"base_color": (0.2, 0.5, 0.2), "roughness": 0.8, "specular": 0.5},
        {"base_color": (1.0, 0.8, 0.4), "metallic": 1, "roughness": 0.2},
        {"base_color": 0.9, "transmission": 1, "roughness": 0.3, "ior": 1.4},
        {"base_color": (0.3, 0.3, 0.9), "transmission": 0.5, "roughness": 0.0},
        {"base_color": 0.8, "alpha": 0.5, "alpha_mode": "blend", "roughness": 0.5},
    ]
    for i, look in enumerate(looks):
        edit.material(f"look{i}", **look)
        place = hg.Pose((i % 3 - 1.0, 1.0 * (i // 3), 0.45))
        edit.entity(f"ball{i}", mesh="ball", material=f"look{i}", transform=place)
    _camera(edit, (0.3, -3.4, 2.0), (0, 0.4, 0.4), 48)
    return {"max_depth": 6}


def textures(edit: Any) -> dict[str, Any]:
    """Textured base colour, roughness, normals, emission and cut-outs."""
    y, x = np.mgrid[0:64, 0:64]
    checker = np.where(((x // 8 + y // 8) % 2)[..., None], (220, 210, 190), (40, 60, 90)).astype(
        "u1"
    )
    bumps = np.stack([np.sin(x * 0.6), np.cos(y * 0.6), np.full(x.shape, 1.5)], -1)
    bumps /= np.linalg.norm(bumps, axis=-1, keepdims=True)
    hole = np.where((x - 32) ** 2 + (y - 32) ** 2 < 400, 255, 0).astype("u1")
    edit.texture("checker", checker)
    edit.texture("bumps", ((bumps * 0.5 + 0.5) * 255).round().astype("u1"), encoding="linear")
    edit.texture("hole", hole, encoding="linear")
    edit.mesh("square", **hg.shapes.plane(2))
    edit.mesh("ball", **hg.shapes.sphere(0.5, 48))
    rough = hg.Tex("hole", scale=0.8, offset=0.1)
    edit.material("tiles", base_color="checker", roughness=rough, normal_map="bumps")
    edit.material("foliage", base_color=(0.2, 0.6, 0.1), alpha="hole", alpha_mode="mask")
    edit.material("lit", base_color=0, emission="checker", emission_strength=3)
    edit.entity("floor", mesh="square", material="tiles", transform=hg.Pose(scale=2))
    edit.entity(
        "leaf", mesh="square", material="foliage", transform=hg.Pose((-0.6, 0, 1.1), scale=0.5)
    )
    edit.entity("glow", mesh="ball", material="lit", transform=hg.Pose((0.7, 0.2, 0.6)))
    edit.dome(color=(0.3, 0.35, 0.4))
    _camera(edit, (0, -3.2, 2.4), (0, 0, 0.4), 50)
    return {"max_depth": 6}


SCENES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "cornell": cornell,
    "materials": materials,
    "textures": textures,
}


def render(client: hg.Client, name: str, spp: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean radiance (H, W, 3) and the variance of its luminance (H, W)."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            options = SCENES[name](edit)
        planes = ["beauty", "variance"]
        frame = scene.render("camera", spp=spp, seed=seed, planes=planes, filter="box", **options)
        return np.array(frame["beauty"][..., :3]), np.array(frame["variance"])
