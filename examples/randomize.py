"""Domain randomisation: every frame is an overlay of one scene, which never changes.

usage: randomize.py [OUT_DIR] [FRAMES]
"""

import colorsys
import json
import sys
from pathlib import Path

import heliograph as hg
import numpy as np

COUNT = 12


def build(scene: hg.Scene) -> tuple[hg.Group, hg.Entity]:
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("die/mesh", **hg.shapes.cube(0.2))
        edit.material("die/material", base_color=0.5)
        dice = edit.instances(
            "die",
            mesh=mesh,
            material="die/material",
            category="die",
            transforms=np.tile(np.eye(4), (COUNT, 1, 1)),
        )
        lens = hg.Camera.from_fov(45, 320, 240, degrees=True)
        cam = edit.entity("cam", camera=lens)
    return dice, cam


def randomise(edit: hg.Edits, rng: np.random.Generator, dice: hg.Group) -> None:
    poses = [
        hg.Pose((*rng.uniform(-0.8, 0.8, 2), 0.1), euler=(0, 0, rng.uniform(0, 6.3))) for _ in dice
    ]
    edit.set_transforms(dice, poses)
    color = colorsys.hsv_to_rgb(rng.random(), 0.7, 0.8)
    edit.material("die/material", base_color=color, roughness=rng.uniform(0.05, 0.9))
    edit.dome(rotation=rng.uniform(0, 6.3), intensity=rng.uniform(0.6, 1.6))
    a, height = rng.uniform(0, 6.3), rng.uniform(0.6, 1.8)
    edit.update("cam", transform=hg.look_at((2 * np.cos(a), 2 * np.sin(a), height), (0, 0, 0)))


def main(out: Path, frames: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("randomize") as scene:
        dice, cam = build(scene)
        for i in range(frames):
            with scene.overlay() as overlay:
                randomise(overlay, np.random.default_rng(i), dice)
            frame = scene.render(
                cam, overlay=overlay, spp=24, seed=i, planes=["beauty", "instance"], labels=True
            )
            frame.save(out / f"{i:03d}.png", exposure="auto")
            boxes = {
                name: {"box": box, "visibility": round(visibility, 3)}
                for name, box, visibility in zip(
                    frame.labels["name"],
                    frame.labels["bbox_visible"].tolist(),
                    frame.labels["visibility"].tolist(),
                    strict=True,
                )
            }
            (out / f"{i:03d}.json").write_text(json.dumps(boxes, indent=1))
            seen = sum(1 for row in boxes.values() if row["visibility"] > 0)
            print(f"{i:03d}.png: {seen} of {len(dice)} dice are seen")


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "out"),
        int(sys.argv[2]) if len(sys.argv) > 2 else 4,
    )
