"""The shortest way from nothing to a picture and its labels. usage: hello.py [OUT_DIR]"""

import sys
from pathlib import Path

import heliograph as hg


def main(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("hello") as scene:
        with scene.edit() as edit:  # one atomic transaction
            edit.sample_studio()  # the bundled dome and floor
            edit.mesh("ball/mesh", **hg.shapes.sphere(0.5))
            edit.mesh("ring/mesh", **hg.shapes.torus(0.4, 0.14))
            edit.material("gold", **hg.materials.gold)
            edit.material("plastic", **hg.materials.plastic)
            edit.entity(
                "ball",
                mesh="ball/mesh",
                material="gold",
                transform=hg.Pose((0, 0, 0.5)),
                category="ball",
            )
            edit.entity(
                "ring",
                mesh="ring/mesh",
                material="plastic",
                transform=hg.Pose((0.9, -0.35, 0.14)),
                category="ring",
            )
            camera = hg.Camera.from_fov(40, 480, 360, degrees=True)
            pose = hg.look_at((1.6, -3.2, 1.5), (0.3, 0, 0.35))
            cam = edit.entity("cam", camera=camera, transform=pose)
        frame = scene.render(cam, spp=48, planes=["beauty", "depth", "normal", "instance"])
        frame.save(out / "hello.png", exposure="auto")
        for label, name in frame.instances.items():
            pixels = int((frame["instance"] == label).sum())
            print(f"{name}: label {label}, {pixels} pixels")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
