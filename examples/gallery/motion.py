"""The picture of docs/motion.md: blur of rotation, of a skin and of lamps, and a rolling shutter.

usage: motion.py OUT.png [SPP]
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import heliograph as hg
import numpy as np

SIZE = (400, 260)
FOX = Path(__file__).resolve().parents[2] / "tests/assets/gltf/Fox.glb"


def lens(**given: object) -> hg.Camera:
    width, height = SIZE
    focal = 1.4 * width
    return hg.Camera(width, height, focal, focal, width / 2 - 0.5, height / 2 - 0.5, **given)


def spokes(count: int, radius: float) -> dict[str, np.ndarray]:
    """Thin boxes about the y axis, as one mesh."""
    cube = hg.shapes.cube(1)
    positions, normals, indices = [], [], []
    for i in range(count):
        angle = 2 * math.pi * i / count
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        box = np.asarray(cube["positions"]) * (0.06, 0.05, radius) + (0, 0, 0.5 * radius)
        positions.append(box @ turn.T)
        normals.append(np.asarray(cube["normals"]) @ turn.T)
        indices.append(np.asarray(cube["indices"]) + i * len(box))
    return {
        "positions": np.concatenate(positions).astype("f4"),
        "normals": np.concatenate(normals).astype("f4"),
        "indices": np.concatenate(indices).astype("u4"),
    }


def wheel(edit: hg.Edits, name: str, color: tuple[float, ...], **given: object) -> None:
    """A wheel that stands in the plane y = 0, of radius 0.5."""
    edit.material(f"{name}/paint", base_color=color, roughness=0.35, clearcoat=0.6)
    edit.material(f"{name}/rubber", base_color=0.04, roughness=0.6)
    hub = edit.entity(name, label=0, **given)
    edit.mesh(f"{name}/spokes/mesh", **spokes(7, 0.45))
    edit.entity(f"{name}/spokes", mesh=f"{name}/spokes/mesh", material=f"{name}/paint", parent=hub)
    edit.mesh(f"{name}/tyre/mesh", **hg.shapes.torus(0.45, 0.06))
    upright = hg.Pose(euler=(math.pi / 2, 0, 0))
    edit.entity(
        f"{name}/tyre",
        mesh=f"{name}/tyre/mesh",
        material=f"{name}/rubber",
        parent=hub,
        transform=upright,
    )


def wheels(edit: hg.Edits) -> None:
    """Two wheels roll by: their feet are sharp, their heads are not."""
    edit.sample_studio()
    for i, (speed, color) in enumerate(((1.2, (0.7, 0.08, 0.05)), (3.5, (0.05, 0.3, 0.7)))):
        keys = hg.moving(
            hg.Pose((i * 1.3 - 0.65, 0, 0.51)),
            (-1, 1),
            velocity=(speed, 0, 0),
            angular_velocity=(0, speed / 0.51, 0),
            time=0,
        )
        wheel(edit, f"wheel/{i}", color, keys=keys)
    camera = lens(shutter=(-0.04, 0.04))
    edit.entity("cam", camera=camera, transform=hg.look_at((0, -4, 0.9), (0, 0, 0.5)))


def fox(edit: hg.Edits) -> None:
    """A camera that goes along with a running fox: the posts behind it smear."""
    edit.sample_studio()
    edit.mesh("post", **hg.shapes.cube(1))
    for i in range(12):
        edit.material(f"post/{i}/paint", base_color=(0.6, 0.1 + 0.06 * i, 0.1), roughness=0.7)
        pose = hg.Pose((-1.4, 0.7 * i - 4, 0.5), scale=(0.12, 0.12, 1))
        edit.entity(f"post/{i}", mesh="post", material=f"post/{i}/paint", transform=pose)
    follow = hg.moving(
        hg.look_at((3.2, -0.4, 1.0), (0, 0, 0.42)), (0, 1), velocity=(0, -4, 0), time=0.25
    )
    run = hg.moving(np.eye(4), (0, 1), velocity=(0, -4, 0), time=0.25)
    runner = edit.entity("runner", keys=run, label=0)
    small = hg.Pose(scale=0.01)
    edit.import_file(FOX, name="fox", animation="Run", parent=runner, transform=small)
    edit.entity("cam", camera=lens(shutter=(-0.015, 0.015)), keys=follow)


def propeller(edit: hg.Edits) -> None:
    """A rolling shutter bends what turns, and leans what passes."""
    edit.sample_studio()
    edit.material("blade/paint", base_color=(0.9, 0.6, 0.05), roughness=0.4)
    edit.mesh("blade", **spokes(3, 0.55))
    keys = hg.moving(hg.Pose((-0.55, 0, 0.75)), (0, 1), angular_velocity=(0, 45, 0))
    edit.entity("blades", mesh="blade", material="blade/paint", keys=keys)
    edit.mesh("pole", **hg.shapes.cube(1))
    edit.material("pole/paint", base_color=(0.1, 0.35, 0.15), roughness=0.5)
    for i in range(3):
        pose = hg.Pose((0.25 + 0.45 * i, 0, 0.65), scale=(0.1, 0.1, 1.3))
        keys = hg.moving(pose, (0, 1), velocity=(5, 0, 0), time=0.05)
        edit.entity(f"pole/{i}", mesh="pole", material="pole/paint", keys=keys)
    camera = lens(shutter=(0, 0.002), rolling=0.1)
    edit.entity("cam", camera=camera, transform=hg.look_at((0, -4, 1.0), (0, 0, 0.65)))


def lamps(edit: hg.Edits) -> None:
    """Lamps on their way round, and the light that they leave behind."""
    edit.mesh("floor/mesh", **hg.shapes.plane(20))
    edit.material("floor/paint", base_color=0.3, roughness=0.25)
    edit.entity("floor", mesh="floor/mesh", material="floor/paint")
    edit.mesh("ball/mesh", **hg.shapes.sphere(0.35))
    edit.material("ball/paint", **{**hg.materials.gold, "roughness": 0.4})
    edit.entity("ball", mesh="ball/mesh", material="ball/paint", transform=hg.Pose((0, 0, 0.35)))
    edit.mesh("lamp/mesh", **hg.shapes.sphere(0.05, 16))
    for i, color in enumerate(((1, 0.25, 0.1), (0.2, 1, 0.4), (0.25, 0.45, 1))):
        arm = edit.entity(
            f"arm/{i}",
            label=0,
            keys=hg.moving(
                hg.Pose((0, 0, 0.2 + 0.35 * i), euler=(0, 0, 2.1 * i)),
                (0, 1),
                angular_velocity=(0, 0, 4.0),
            ),
        )
        edit.entity(
            f"lamp/{i}",
            mesh="lamp/mesh",
            parent=arm,
            transform=hg.Pose((0.7, 0, 0)),
            light=hg.Light(power=12.0, color=color),
        )
    camera = lens(shutter=(0, 1))
    edit.entity("cam", camera=camera, transform=hg.look_at((0, -3.6, 1.7), (0, 0, 0.4)))


PANELS = ((wheels, 0.0, "auto"), (fox, 0.25, "auto"), (propeller, 0.0, "auto"), (lamps, 0.0, 0.0))


def main(out: Path, spp: int) -> None:
    from PIL import Image

    pictures = []
    with hg.connect() as client:
        for build, time, exposure in PANELS:
            with client.create_scene(build.__name__) as scene:
                with scene.edit() as edit:
                    build(edit)
                frame = scene.render("cam", spp=spp, time=time, max_depth=6)
                pictures.append(frame.image(view="filmic", exposure=exposure))
    rows = [np.concatenate(pictures[i : i + 2], axis=1) for i in (0, 2)]
    image = Image.fromarray(np.concatenate(rows, axis=0))
    image.quantize(160, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 256)
