"""The picture of docs/nvisii.md: every mesh that nvisii makes by a formula.

usage: nvisii_meshes.py OUT.png [SPP]
"""

from __future__ import annotations

import colorsys
import sys
from pathlib import Path
from typing import Any

import nvisii

PATH = [(-0.8, 0, -0.8), (-0.5, 0.3, 0), (0.3, 0, 0.3), (0.8, -0.2, 0.9)]
COLUMNS, STEP = 8, 2.6
ARGUMENTS: dict[str, dict[str, Any]] = {
    "box": {},
    "rounded_box": {},
    "plane": {},
    "sphere": {},
    "icosphere": {},
    "icosahedron": {},
    "dodecahedron": {},
    "teapotahedron": {},
    "cylinder": {},
    "capped_cylinder": {},
    "cone": {},
    "capped_cone": {},
    "spherical_cone": {},
    "capsule": {},
    "tube": {},
    "capped_tube": {},
    "disk": {},
    "torus": {},
    "torus_knot": {},
    "spring": {},
    "triangle": {},
    "spherical_triangle_from_sphere": {},
    "convex_polygon_from_circle": {},
    "convex_polygon": {"vertices": [(-0.8, -0.5), (0.8, -0.5), (0.5, 0.8), (-0.3, 0.9)]},
    "line": {"start": (-0.7, -0.7, -0.7), "stop": (0.7, 0.7, 0.7), "radius": 0.1},
    "tube_from_polyline": {"path": PATH, "radius": 0.2},
    "rectangle_tube_from_polyline": {"path": PATH, "size": (0.2, 0.1)},
    "rounded_rectangle_tube_from_polyline": {"path": PATH, "radius": 0.1, "size": (0.2, 0.1)},
    "wireframe_bounding_box": {"thickness": 0.05},
}


def main(out: Path, samples: int) -> None:
    nvisii.initialize(headless=True)
    nvisii.set_dome_light_color((0.14, 0.16, 0.2))
    lamp = nvisii.entity.create(
        "key",
        transform=nvisii.transform.create("key", position=(-4, -20, 14)),
        mesh=nvisii.mesh.create_sphere("key", 2),
        light=nvisii.light.create_from_temperature("key", 5000, 5000),
    )
    lamp.set_visibility(camera=False)
    for i, (name, arguments) in enumerate(ARGUMENTS.items()):
        size = 0.3 if name == "teapotahedron" else 0.8
        place = nvisii.transform.create(
            name,
            scale=(size, size, size),
            position=(i % COLUMNS * STEP, 0, -(i // COLUMNS) * STEP),
            rotation=nvisii.angleAxis(0.5, (1, 0, 0)) * nvisii.angleAxis(0.5, (0, 0, 1)),
        )
        nvisii.entity.create(
            name,
            transform=place,
            mesh=getattr(nvisii.mesh, f"create_{name}")(name, **arguments),
            material=nvisii.material.create(
                name, base_color=colorsys.hsv_to_rgb(i / len(ARGUMENTS), 0.7, 0.7)
            ),
        )
    middle = ((COLUMNS - 1) / 2 * STEP, 0, -1.5 * STEP)
    camera = nvisii.entity.create(
        "camera",
        transform=nvisii.transform.create("camera"),
        camera=nvisii.camera.create("camera", 0.34, 2.0),
    )
    camera.get_transform().look_at(at=middle, up=(0, 0, 1), eye=(middle[0], -32, middle[2]))
    nvisii.set_camera_entity(camera)
    nvisii.render_to_file(720, 360, samples, str(out))
    nvisii.deinitialize()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 64)
