"""The picture of docs/lights.md: shapes, spot lights, light groups, a shadow catcher, skies.

usage: lights.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from heliograph import tonemap

TILE = (240, 180)
DOWN = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2.2], [0, 0, 0, 1]])
CAMERA = hg.Camera.from_fov(42, *TILE, degrees=True)

SHAPES = (
    hg.Light(power=60, shape="sphere", radius=0.25),
    hg.Light(power=60, shape="disc", radius=0.5),
    hg.Light(power=60, shape="rectangle", width=2.4, height=0.15),
)
SPOTS = (
    hg.Light(intensity=40, shape="sphere", radius=0.02, outer_cone_angle=0.45),
    hg.Light(
        intensity=40, shape="sphere", radius=0.02, outer_cone_angle=0.45, inner_cone_angle=0.43
    ),
    hg.Light(intensity=40, shape="disc", radius=0.4, outer_cone_angle=0.45, temperature=2700),
)
MIXES = ({"key": 1, "fill": 1}, {"key": 0.1, "fill": 3}, {"key": (1, 0.5, 0.2), "fill": 0.15})
ELEVATIONS = (0.03, 0.25, 1.0)


def still_life(edit: hg.Edits, floor: float = 9.0) -> None:
    """A ball, a box and a ring on a floor of so many metres before a wall; 0: neither."""
    edit.material("white", base_color=0.7, roughness=0.6)
    edit.material("red", base_color=(0.6, 0.06, 0.04), roughness=0.25)
    edit.material("gold", **hg.materials.gold)
    ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.4))
    box = edit.mesh("box/mesh", **hg.shapes.cube(0.6))
    ring = edit.mesh("ring/mesh", **hg.shapes.torus(0.32, 0.1))
    edit.entity("ball", mesh=ball, material="red", transform=hg.Pose((-0.75, 0, 0.4)))
    edit.entity("box", mesh=box, material="white", transform=hg.Pose((0.1, 0.45, 0.3)))
    edit.update("box", transform=hg.Pose((0.1, 0.45, 0.3), euler=(0, 0, 0.5)))
    edit.entity("ring", mesh=ring, material="gold", transform=hg.Pose((0.8, -0.1, 0.1)))
    if floor:
        ground = edit.mesh("ground", **hg.shapes.plane(floor))
        edit.entity("floor", mesh=ground, material="white")
        plane = edit.mesh("plane", **hg.shapes.plane(9))
        wall = hg.Pose((0, 2, 0), euler=(np.pi / 2, 0, 0))
        edit.entity("wall", mesh=plane, material="white", transform=wall)
    pose = hg.look_at((0, -4.6, 1.5), (0, 0, 0.75))
    edit.entity("camera", camera=CAMERA, transform=pose)


def lamps(client: hg.Client, spp: int, lights: tuple[hg.Light, ...]) -> list[np.ndarray]:
    with client.create_scene() as scene:
        with scene.edit() as edit:
            still_life(edit)
            edit.dome(color=0.02)
        out = []
        for light in lights:
            with scene.overlay() as lit:
                lit.entity("lamp", light=light, transform=DOWN)
            frame = scene.render("camera", spp=spp, overlay=lit, clamp_indirect=2)
            out.append(frame.image(view="filmic"))
        return out


def groups(client: hg.Client, spp: int) -> list[np.ndarray]:
    """Renders once and mixes the light groups anew."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            still_life(edit)
            key = hg.Light(power=60, shape="disc", radius=0.3)
            fill = hg.Light(power=25, shape="rectangle", color=(0.4, 0.6, 1.0))
            left = hg.look_at((-2, -1.5, 2.5), (0, 0, 0.3))
            right = hg.look_at((2.5, -1.5, 1.2), (0, 0, 0.3))
            edit.entity("key", light=key, transform=left, light_group="key")
            edit.entity("fill", light=fill, transform=right, light_group="fill")
        frame = scene.render(
            "camera", planes=["beauty", "beauty:key", "beauty:fill"], spp=spp, clamp_indirect=2
        )
        return [tonemap.to_srgb8(frame.relight(mix)[..., :3], 0.0, "filmic") for mix in MIXES]


def backplate() -> np.ndarray:
    """(H, W, 3) linear: boards that run to the horizon, as a photograph would show them."""
    y, x = np.mgrid[0 : TILE[1], 0 : TILE[0]] + 0.5
    down = np.maximum(y / TILE[1] - 0.2, 1e-3)
    board = np.floor((x / TILE[0] - 0.5) / down * 3)
    shade = 0.25 + 0.1 * np.modf(np.abs(np.sin(board * 12.9898) * 43758.5))[0]
    wood = shade[..., None] * (1.0, 0.65, 0.4)
    return np.where((y / TILE[1] < 0.2)[..., None], (0.3, 0.34, 0.4), wood)


def catcher(client: hg.Client, spp: int) -> list[np.ndarray]:
    """The objects alone, the plane shadow_catcher, and both over a photograph."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            still_life(edit, floor=0)
            plane = edit.mesh("plane", **hg.shapes.plane(60))
            edit.entity("table", mesh=plane, material="white", shadow_catcher=True)
            edit.dome(color=(0.5, 0.55, 0.6))
            sun = hg.Light(irradiance=2.5, sun_angle=0.06)
            edit.entity("sun", light=sun, transform=hg.look_at((-2, -1, 2.2), (0, 0, 0)))
        frame = scene.render(
            "camera", planes=["beauty", "shadow_catcher"], spp=spp, transparent_background=True
        )
        color, alpha = frame["beauty"][..., :3], frame["beauty"][..., 3:]
        shadow = frame["shadow_catcher"][..., None]
        layers = (
            color + (1 - alpha) * 0.8,
            np.broadcast_to(shadow, color.shape),
            color + (1 - alpha) * shadow * backplate(),
        )
        return [tonemap.to_srgb8(layer, 0.0, "standard") for layer in layers]


def skies(client: hg.Client, spp: int) -> list[np.ndarray]:
    out = []
    for elevation in ELEVATIONS:
        with client.create_scene() as scene:
            with scene.edit() as edit:
                still_life(edit, floor=2000)
                edit.update("wall", visible=False)
                edit.sky(elevation, 2.2)
            frame = scene.render("camera", spp=spp)
            out.append(frame.image(exposure="auto", view="filmic"))
    return out


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client:
        rows = [lamps(client, spp, SHAPES), lamps(client, spp, SPOTS)]
        rows += [groups(client, spp), catcher(client, spp), skies(client, spp)]
    tiles = np.concatenate([np.concatenate(row, axis=1) for row in rows])
    image = Image.fromarray(np.ascontiguousarray(tiles))
    palette = image.quantize(256)
    image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 128)
