"""A clean YOLO data set of poses, and one of boxes and of segments; faults to plant in it."""

from __future__ import annotations

from pathlib import Path

from shapes_seen import edit_text, picture

LABEL = "labels/train/000000.txt"
BOX = "0 0.500000 0.500000 0.250000 0.500000"
POSE = f"{BOX} 0.450000 0.400000 2 0 0 0"
OTHER = "1 0.200000 0.300000 0.400000 0.200000 0.1 0.3 1 0.25 0.31 2"
SEGMENT = "1 0.1 0.1 0.4 0.1 0.4 0.6 0.1 0.6"


def make(root: Path) -> None:
    for split, index in (("train", 0), ("train", 1), ("val", 2)):
        picture(root / f"images/{split}/{index:06d}.png", index)
        path = root / f"labels/{split}/{index:06d}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("" if index == 1 else f"{POSE}\n{OTHER}\n")
    (root / "data.yaml").write_text(
        "# two classes\ntrain: images/train\nval: images/val\nnc: 2\n"
        'names:\n  0: "bolt, big"\n  1: nut  # small\nkpt_shape: [2, 3]\n'
    )


def without_poses(root: Path, lines: str) -> None:
    """The same set as boxes or segments."""
    edit_text(root / "data.yaml", "kpt_shape: [2, 3]\n", "")
    for path in (root / "labels").glob("*/*.txt"):
        if path.read_text():
            path.write_text(lines)


def text(old: str, new: str, file: str = LABEL):
    return lambda root: edit_text(root / file, old, new)


def segments(line: str):
    return lambda root: [
        without_poses(root, f"{SEGMENT}\n"),
        edit_text(root / LABEL, SEGMENT, line),
    ]


FAULTS = {
    "picture is none": (
        "yolo.format",
        lambda root: (root / "images/val/000002.png").write_text("JFIF"),
    ),
    "data.yaml is none": ("yolo.format", text("nc: 2", "nc: [2", "data.yaml")),
    "data.yaml has an alias": (
        "yolo.format",
        text("val: images/val", "val: &v images/val\ntest: *v", "data.yaml"),
    ),
    "data.yaml is a list": (
        "yolo.format",
        lambda root: (root / "data.yaml").write_text("- images\n"),
    ),
    "nc": ("yolo.data", text("nc: 2", "nc: 3", "data.yaml")),
    "names from 1": (
        "yolo.data",
        lambda root: [
            edit_text(root / "data.yaml", *c) for c in (("  1:", "  2:"), ("  0:", "  1:"))
        ],
    ),
    "no val": ("yolo.data", text("val: images/val\n", "", "data.yaml")),
    "label removed": ("yolo.counts", lambda root: (root / "labels/train/000001.txt").unlink()),
    "picture removed": ("yolo.counts", lambda root: (root / "images/train/000001.png").unlink()),
    "keypoint missing": ("yolo.fields", text(" 2 0 0 0", " 2")),
    "segment of two points": ("yolo.fields", segments("1 0.1 0.1 0.4 0.1 0.3")),
    "boxes among segments": ("yolo.fields", segments(BOX)),
    "class from 1": ("yolo.classes", text(OTHER, "2" + OTHER[1:])),
    "class by name": ("yolo.classes", text(OTHER, "nut" + OTHER[1:])),
    "pixels": ("yolo.range", text("0.250000 0.500000", "12 16")),
    "keypoint in pixels": ("yolo.range", text("0.450000 0.400000", "21.6 12.8")),
    "corners instead of centre": (
        "yolo.bbox",
        text("0.200000 0.300000 0.400000 0.200000", "0.1 0.3 0.4 0.5"),
    ),
    "no width": ("yolo.bbox", text("0.250000 0.500000", "0 0.5")),
    "outline of nothing": ("yolo.segment", segments("1 0.1 0.1 0.4 0.1 0.2 0.1")),
    "v is 3": ("yolo.keypoints", text("0.400000 2", "0.400000 3")),
    "v is 0 but placed": ("yolo.keypoints", text("0.400000 2", "0.400000 0")),
    "line twice": ("yolo.duplicates", text(OTHER, f"{OTHER}\n{OTHER}")),
}
