"""The picture of docs/lights.md on luminaires: three lamps by their .ies files, before a wall.

usage: profiles.py OUT.png [SPP]
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import heliograph as hg
import numpy as np

TILE = (300, 260)
VERTICAL = np.arange(0, 91, 2.5)

Candela = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of vertical and horizontal degrees


def lobe(vertical: np.ndarray, centre: float, width: float) -> np.ndarray:
    return np.exp(-0.5 * ((vertical - centre) / width) ** 2)


def even(vertical: np.ndarray) -> np.ndarray:
    """Profile that lights a wall evenly from 14 degrees off its foot to 60: E = I sin^3 /
    distance^2."""
    sine = np.sin(np.radians(np.maximum(vertical, 1)))
    return np.minimum(1, (0.24 / sine) ** 3) * (vertical < 60)


# Name, range of the horizontal angles, candela.
LAMPS: tuple[tuple[str, np.ndarray, Candela], ...] = (
    (
        "downlight",
        np.array([0.0]),
        lambda v, h: 900 * lobe(v, 0, 14) + 260 * lobe(v, 38, 3),
    ),
    (
        "wall washer",  # towards 90 degrees
        np.arange(90, 271, 15.0),
        lambda v, h: 900 * even(v) * lobe(h, 90, 60) + 60 * lobe(v, 0, 30),
    ),
    (
        "trough",
        np.arange(0, 91, 15.0),
        lambda v, h: 80 * lobe(v, 0, 40) + 800 * lobe(v, 42, 10) * lobe(h, 0, 30),
    ),
)


def ies(horizontal: np.ndarray, candela: Candela) -> str:
    """The text of a file."""
    head = f"1 -1 1 {len(VERTICAL)} {len(horizontal)} 1 2 0 0 0\n1 1 0"
    rows = [VERTICAL, horizontal]
    rows += [candela(VERTICAL, np.full_like(VERTICAL, h)) * (VERTICAL < 90) for h in horizontal]
    lines = [" ".join(f"{x:.1f}" for x in row) for row in rows]
    return "\n".join(["IESNA:LM-63-2002", "TILT=NONE", head, *lines, ""])


def render(client: hg.Client, lamp: Path, spp: int) -> np.ndarray:
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.material("paint", base_color=(0.75, 0.7, 0.62), roughness=0.8)
            plane = edit.mesh("plane", **hg.shapes.plane(12))
            edit.entity("floor", mesh=plane, material="paint")
            wall = hg.Pose((0, 0.9, 0), euler=(np.pi / 2, 0, 0))
            edit.entity("wall", mesh=plane, material="paint", transform=wall)
            ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.3))
            edit.entity("ball", mesh=ball, material="paint", transform=hg.Pose((0.9, 0.2, 0.3)))
            light = hg.Light(
                profile=edit.texture("lamp/candela", lamp),
                temperature=3500,
                shape="disc",
                radius=0.04,
            )
            edit.entity("lamp", light=light, transform=hg.Pose((0, 0.3, 2.6)))
            camera = hg.Camera.from_fov(52, *TILE, degrees=True)
            edit.entity("camera", camera=camera, transform=hg.look_at((0, -4.2, 1.5), (0, 0, 1.25)))
        frame = scene.render("camera", spp=spp, clamp_indirect=2)
        return frame.image(exposure="auto", view="filmic")


def main(out: Path, spp: int) -> None:
    from PIL import Image

    tiles = []
    with hg.connect() as client, tempfile.TemporaryDirectory() as folder:
        for name, horizontal, candela in LAMPS:
            path = Path(folder) / f"{name}.ies"
            path.write_text(ies(horizontal, candela))
            tiles.append(render(client, path, spp))
    image = Image.fromarray(np.ascontiguousarray(np.concatenate(tiles, axis=1)))
    image.quantize(256).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 128)
