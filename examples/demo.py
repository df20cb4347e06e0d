"""Renders a helmet: a picture, its planes, a labelled sequence, and the time that each took.

Run by scripts/demo. usage: demo.py [OUT_DIR]
"""

from __future__ import annotations

import colorsys
import json
import math
import statistics
import sys
import time
from pathlib import Path

import heliograph as hg
import numpy as np
from heliograph.datasets import bundled_domes
from PIL import Image, ImageDraw

ASSETS = Path(__file__).parent / "assets"
DOMES = {path.stem: path for path in bundled_domes()}
TARGET = (0.0, 0.0, 0.36)
VIEW = "agx"
PLANES = [
    *("beauty", "depth", "normal", "base_color"),
    *("roughness", "metallic", "instance", "part"),
    *("nocs", "flow_backward", "direct_diffuse", "direct_glossy"),
]
PROPS = ("sphere", "torus", "cube", "cylinder")


def turned(angle: float, position: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> hg.Pose:
    return hg.Pose(position, euler=(0.0, 0.0, angle))


def orbit(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """Camera pose around the helmet; degrees, metres. Azimuth 0 looks it in the face."""
    a, e = math.radians(azimuth), math.radians(elevation)
    offset = (math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e))
    return hg.look_at(np.array(TARGET) + distance * np.array(offset), TARGET)


def build(scene: hg.Scene) -> None:
    """The helmet on a floor in a room, and a camera before it."""
    with scene.edit() as edit:
        edit.import_file(
            ASSETS / "FlightHelmet/FlightHelmet.gltf", name="helmet", category="helmet"
        )
        edit.mesh("floor/mesh", **hg.shapes.plane(30.0))
        edit.material("floor/material", base_color=(0.46, 0.42, 0.38), roughness=0.32)
        edit.entity("floor", mesh="floor/mesh", material="floor/material", label=0)
        edit.dome(DOMES["interior"], rotation=math.radians(200))
        camera = hg.Camera.from_fov(30, 640, 640, degrees=True)
        edit.entity("camera", camera=camera, transform=orbit(24, 7, 1.75))


def captioned(picture: np.ndarray, caption: str, size: int) -> Image.Image:
    """A picture or grey image, `size` pixels square, with a caption."""
    image = Image.fromarray(np.ascontiguousarray(picture)).convert("RGB")
    image = image.resize((size, size), Image.Resampling.LANCZOS)
    draw = ImageDraw.Draw(image, "RGBA")
    box = draw.textbbox((10, 9), caption, font_size=15)
    draw.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), fill=(0, 0, 0, 150))
    draw.text((10, 9), caption, font_size=15, fill=(255, 255, 255))
    return image


def flow_picture(flow: np.ndarray) -> np.ndarray:
    """Hue is the direction, saturation the length relative to the longest (Baker et al. 2011)."""
    length = np.linalg.norm(flow, axis=-1)
    saturation = length / max(float(length.max()), 1e-6)
    sector = ((np.arctan2(flow[..., 1], flow[..., 0]) / (2 * np.pi)) % 1.0 * 255).astype(int)
    wheel = np.array([colorsys.hsv_to_rgb(i / 256, 1.0, 1.0) for i in range(256)])
    return ((1 - saturation[..., None] * (1 - wheel[sector])) * 255).astype(np.uint8)


def picture_of(frame: hg.Frame, plane: str) -> np.ndarray:
    if plane == "flow_backward":
        return flow_picture(frame[plane])
    if plane == "depth":  # a floor to the horizon would leave no contrast for what is near
        near = np.nanmin(frame[plane])
        return (255 * np.clip(near / frame[plane], 0, 1) ** 1.5).astype(np.uint8)
    return frame.picture(plane, exposure="auto", view=VIEW)


def contact_sheet(scene: hg.Scene, path: Path, size: int = 300, columns: int = 4) -> None:
    """Renders all PLANES of one frame, in which the helmet turns by four degrees in 33 ms."""
    with scene.edit() as edit:
        edit.advance(1 / 30)
        edit.update("helmet", transform=turned(math.radians(4)))
    frame = scene.render("camera", planes=PLANES, spp=24, size=(size, size))
    sheet = Image.new("RGB", (columns * size, -(-len(PLANES) // columns) * size))
    for i, plane in enumerate(PLANES):
        tile = captioned(picture_of(frame, plane), plane, size)
        sheet.paste(tile, (i % columns * size, i // columns * size))
    sheet.save(path)


def add_props(edit: hg.Edits) -> None:
    """Four small things with a class each."""
    for kind in PROPS:
        edit.mesh(f"{kind}/mesh", **getattr(hg.shapes, kind)())
        edit.material(f"{kind}/material", base_color=0.5)
        edit.entity(kind, mesh=f"{kind}/mesh", material=f"{kind}/material", category=kind)


def randomise(edit: hg.Edits, rng: np.random.Generator) -> None:
    """Draws poses, materials, the light's direction and the camera's pose."""
    edit.update("helmet", transform=turned(rng.uniform(-0.6, 0.6)))
    start = rng.uniform(0, 2 * math.pi)
    for i, kind in enumerate(PROPS):
        angle = start + i * math.pi / 2 + rng.uniform(-0.5, 0.5)
        radius, scale = rng.uniform(0.34, 0.55), rng.uniform(0.1, 0.2)
        height = 0.15 if kind == "torus" else 0.5
        at = (radius * math.cos(angle), radius * math.sin(angle), height * scale)
        edit.update(kind, transform=hg.Pose(at, euler=(0, 0, rng.uniform(0, 6.3)), scale=scale))
        metallic = float(rng.random() < 0.35)
        color = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.3, 0.85), rng.uniform(0.4, 0.9))
        edit.material(
            f"{kind}/material",
            base_color=color,
            metallic=metallic,
            roughness=rng.uniform(0.08, 0.6),
            transmission=float(not metallic and rng.random() < 0.3),
        )
    edit.material("floor/material", base_color=rng.uniform(0.15, 0.6) * rng.uniform(0.85, 1, 3))
    sky = DOMES["interior" if rng.random() < 0.5 else "forest"]
    edit.dome(sky, rotation=rng.uniform(0, 2 * math.pi))
    pose = orbit(rng.uniform(-55, 55), rng.uniform(6, 32), rng.uniform(1.7, 2.4))
    edit.update("camera", transform=pose)


def jsonable(column: object) -> object:
    """A label column as lists; null for numbers that are not finite."""
    values = np.asarray(column)
    if values.dtype.kind == "f":
        return np.where(np.isfinite(values), values.astype(object), None).tolist()
    return values.tolist()


def sequence(scene: hg.Scene, folder: Path, count: int = 10) -> float:
    """Randomised frames with their labels; frames per second, without the writing of files."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(7)
    with scene.edit() as edit:
        add_props(edit)
    seconds = 0.0
    for i in range(count):
        start = time.perf_counter()
        with scene.edit() as edit:
            randomise(edit, rng)
        frame = scene.render(
            "camera",
            planes=["beauty", "depth", "instance"],
            spp=16,
            size=(320, 320),
            seed=i,
            labels=True,
        )
        seconds += time.perf_counter() - start
        boxes = frame.annotated(exposure="auto", view=VIEW)
        Image.fromarray(boxes).save(folder / f"{i:03d}.png")
        labels = {
            "revision": frame.revision,
            "K": frame.K.tolist(),
            "camera_from_world_cv": frame.camera_from_world_cv.tolist(),
            "categories": frame.categories,
            "instances": {name: jsonable(frame.labels[name]) for name in frame.labels},
        }
        (folder / f"{i:03d}.json").write_text(json.dumps(labels))
    return count / seconds


def edit_latency(scene: hg.Scene, count: int = 20) -> float:
    """Median seconds from the call of an edit to the pixels in numpy: 256x256, 1 sample."""
    taken = []
    for i in range(count):
        start = time.perf_counter()
        with scene.edit() as edit:
            edit.update("helmet", transform=turned(0.1 * i))
        scene.render("camera", spp=1, size=(256, 256), seed=i)["beauty"]
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def main(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    with hg.connect() as client, client.create_scene("demo") as scene:
        build(scene)
        frame = scene.render("camera", planes=["beauty", "depth"], spp=48, seed=1)
        Image.fromarray(frame.image(exposure="auto", view=VIEW)).save(out / "helmet.png")
        rays = frame.rays / frame.render_seconds
        contact_sheet(scene, out / "planes.png")
        rate = sequence(scene, out / "sequence")
        latency = edit_latency(scene)
    print(f"{out}/helmet.png       {frame.width}x{frame.height}, {frame.samples} samples per pixel")
    print(f"{out}/planes.png       {len(PLANES)} planes of one frame")
    print(f"{out}/sequence/        ten randomised frames with labels")
    print(f"frames per second     {rate:.2f}   (320x320, 16 samples, depth, instance, labels)")
    print(f"rays per second       {rays / 1e6:.2f} million   (helmet.png)")
    print(f"edit to frame         {latency * 1e3:.1f} ms   (256x256, 1 sample, pixels in numpy)")
    print(f"in all                {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
