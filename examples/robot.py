"""A robot of a URDF file: draws its joints into the picture, and the motion of its links.

usage: robot.py [OUT_DIR] [FRAMES]
"""

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from PIL import Image, ImageDraw

ARM = Path(__file__).parent / "assets/arm/arm.urdf"


def build(scene: hg.Scene) -> tuple[hg.Robot, hg.Entity]:
    with scene.edit() as edit:
        edit.sample_studio()
        arm = edit.import_urdf(ARM, category="arm")
        edit.set_joints(arm, {"shoulder": 0.4, "elbow": 0.9, "wrist": 0.6, "grip": 0.03})
        lens = hg.Camera.from_fov(45, 480, 360, degrees=True)
        pose = hg.look_at((1.3, -1.7, 1.0), (0.2, 0, 0.45))
        return arm, edit.entity("cam", camera=lens, transform=pose)


def draw_skeleton(frame: hg.Frame, arm: hg.Robot) -> Image.Image:
    """The picture with the joints that can be seen, and the lines between neighbours."""
    labels = frame.labels
    at = dict(zip(labels["keypoint_name"], map(tuple, labels["keypoint_image"]), strict=True))
    seen = dict(zip(labels["keypoint_name"], labels["keypoint_state"] == 3, strict=True))
    picture = Image.fromarray(frame.image(exposure="auto"))
    draw = ImageDraw.Draw(picture)
    for a, b in arm.skeleton:
        draw.line([at[a], at[b]], fill=(60, 220, 90), width=2)
    for name, (x, y) in at.items():
        color = (255, 255, 255) if seen[name] else (200, 40, 40)
        draw.ellipse([x - 4, y - 4, x + 4, y + 4], fill=color)
    return picture


def main(out: Path, frames: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("robot") as scene:
        arm, cam = build(scene)
        print(f"{arm}: {', '.join(arm.joint_names)}")
        rng = np.random.default_rng(0)
        values = arm.rest + (0, 0.4, 0.9, 0.6, 0.03)
        for i in range(frames):
            values = values + rng.uniform(-0.2, 0.2, 5) * (1, 1, 1, 1, 0.1)
            with scene.edit() as edit:
                edit.advance(1 / 30)  # keys the old pose: flow is from there
                edit.set_joints(arm, values, clamp=True)
            frame = scene.render(
                cam,
                spp=32,
                seed=i,
                planes=["beauty", "part", "flow_backward"],
                labels={"keypoints": True, "keypoint_radius": 0.12},
            )
            draw_skeleton(frame, arm).save(out / f"{i:03d}.png")
            tip = arm.forward(values, clamp=True)[arm.link_names.index("tool"), :3, 3]
            flow = np.linalg.norm(frame["flow_backward"], axis=-1).max()
            links = np.unique(arm.link_of(frame["part"]))
            seen = [arm.link_names[link] for link in links if link >= 0]
            print(f"{i:03d}.png: tool at {tip.round(3)}, up to {flow:.1f} px, {', '.join(seen)}")


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "out"),
        int(sys.argv[2]) if len(sys.argv) > 2 else 3,
    )
