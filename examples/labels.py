"""Prints every label column of one frame, and checks three invariants of labels on it.

usage: labels.py [OUT_DIR]
"""

import sys
from pathlib import Path

import heliograph as hg
import numpy as np
from PIL import Image


def build(scene: hg.Scene) -> hg.Entity:
    with scene.edit() as edit:
        edit.sample_studio()
        post = edit.mesh("post", **hg.shapes.cylinder(0.15, 1.4), keypoints={"top": (0, 0, 0.7)})
        ball = edit.mesh("ball", **hg.shapes.sphere(0.4))
        steel = edit.material("steel", **hg.materials.steel)
        clay = edit.material("clay", base_color=(0.65, 0.25, 0.15), roughness=0.8)
        for i, x in enumerate((-0.7, 0.0, 0.7)):
            pose = hg.Pose((x, 0.0, 0.4))
            edit.entity(f"ball/{i}", mesh=ball, material=clay, transform=pose, category="ball")
        pose = hg.Pose((0.25, -0.7, 0.7))
        edit.entity("post/0", mesh=post, material=steel, transform=pose, category="post")
        lens = hg.Camera.from_fov(42, 480, 360, degrees=True)
        return edit.entity("cam", camera=lens, transform=hg.look_at((0.5, -3.4, 1.4), (0, 0, 0.5)))


def check(frame: hg.Frame) -> None:
    """Boxes are the masks' extents; depth is position_camera's z; visible is inside amodal."""
    labels, ids = frame.labels, frame["instance"]
    for label, box in zip(labels["label"], labels["bbox_visible"], strict=True):
        mask = ids == label
        assert not (mask & ~frame.amodal_mask(label)).any()
        if mask.any():
            ys, xs = np.nonzero(mask)
            assert box.tolist() == [xs.min(), ys.min(), xs.max() + 1, ys.max() + 1]
    hit = np.isfinite(frame["depth"])
    assert np.allclose(frame["depth"][hit], frame["position_camera"][hit][:, 2], atol=1e-5)


def main(out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("labels") as scene:
        cam = build(scene)
        frame = scene.render(
            cam,
            spp=32,
            planes=["beauty", "depth", "position_camera", "instance"],
            labels={"boxes": True, "amodal": True, "amodal_masks": True, "keypoints": True},
        )
    check(frame)
    Image.fromarray(frame.annotated(exposure="auto")).save(out / "labels.png")
    for name in frame.labels:
        column = frame.labels[name]
        shape = column.shape if isinstance(column, np.ndarray) else f"{len(column)} texts"
        print(f"{name:<28}{shape}")
    for name, share in zip(frame.labels["name"], frame.labels["visibility"], strict=True):
        print(f"{name}: {share:.0%} visible")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out"))
