"""The picture of docs/cameras.md: one scene by six cameras.

usage: cameras.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from heliograph import studio

WIDTH, HEIGHT = 320, 214
EYE, TARGET = (0.0, -4.2, 1.5), (0.0, 0.0, 0.55)
FOCUS = float(np.linalg.norm(np.subtract(TARGET, EYE)))

CAMERAS = {
    "perspective": hg.Camera.from_fov(55, WIDTH, HEIGHT, degrees=True),
    "thin lens": hg.Camera.from_fov(
        *(55, WIDTH, HEIGHT),
        **{"degrees": True, "aperture": 0.3, "focus_distance": FOCUS, "blades": 6},
    ),
    "orthographic": hg.Camera.orthographic(74, WIDTH, HEIGHT),
    "barrel": hg.Camera.from_fov(
        *(80, WIDTH, HEIGHT), degrees=True, distortion=(-0.32, 0.09, 0.0, 0.0, -0.008)
    ),
    "fisheye": hg.Camera.fisheye(290, WIDTH, HEIGHT, degrees=True),
    "equirectangular": hg.Camera.equirectangular(WIDTH, HEIGHT),
}


def checkers(edit: hg.Edits) -> None:
    """A floor of squares of 0.5 m."""
    squares = np.indices((2, 2)).sum(0) % 2
    edit.texture("checkers", (0.12 + 0.5 * squares[..., None]).astype("f4"), filter="nearest")
    use = hg.Tex("checkers", uv=[[12, 0, 0], [0, 12, 0]])
    edit.material("floor/material", base_color=use, roughness=0.5)
    edit.entity(
        "floor", mesh=edit.mesh("floor/mesh", **hg.shapes.plane(12)), material="floor/material"
    )


def build(edit: hg.Edits) -> None:
    edit.dome(studio.dome())
    checkers(edit)
    ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.5, 96))
    cube = edit.mesh("cube/mesh", **hg.shapes.cube(1.0))
    lamp = edit.mesh("lamp/mesh", **hg.shapes.sphere(0.03, 24))
    edit.material("gold", **hg.materials.gold)
    for i, color in enumerate([(0.6, 0.05, 0.03), (0.04, 0.25, 0.5), (0.1, 0.4, 0.08)]):
        material = edit.material(f"paint {i}", base_color=color, roughness=0.3)
        y = 2.6 * i - 1.8
        pose = hg.Pose((1.5 - 0.5 * i, y, 0.5), euler=(0, 0, 0.5 + i))
        edit.entity(f"cube {i}", mesh=cube, material=material, transform=pose)
        edit.entity(
            f"far {i}", mesh=ball, material=material, transform=hg.Pose((1.5 * i - 2, 5, 0.5))
        )
    edit.entity("ball", mesh=ball, material="gold", transform=hg.Pose((-0.6, 0, 0.5)))
    for i in range(9):
        place = (-3.2 + 0.8 * i, 4.5, 1.5 + 0.5 * (i % 2))
        light = hg.Light(radiance=400, color=(1, 0.75, 0.45))
        edit.entity(f"lamp {i}", mesh=lamp, light=light, transform=hg.Pose(place))
    for name, camera in CAMERAS.items():
        edit.entity(name, camera=camera, transform=hg.look_at(EYE, TARGET, (0, 0, 1)))


def main(out: Path, spp: int) -> None:
    from PIL import Image

    with hg.connect() as client, client.create_scene("cameras") as scene:
        with scene.edit() as edit:
            build(edit)
        frames = scene.render(list(CAMERAS), spp=spp, max_depth=6)
    images = [frame.image(exposure=-0.7, view="filmic") for frame in frames]
    rows = [np.concatenate(images[i : i + 3], axis=1) for i in range(0, len(images), 3)]
    picture = Image.fromarray(np.concatenate(rows))
    picture.convert("RGB").quantize(160, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 256)
