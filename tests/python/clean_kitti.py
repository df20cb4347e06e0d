"""A clean KITTI data set: boxes on a plane by arithmetic, maps by OpenCV; faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from shapes_seen import HEIGHT, WIDTH, K, edit_text, picture

BASE = "training"
LABEL = f"{BASE}/label_2/000000.txt"


def line(place: tuple[float, float, float], turn: float) -> str:
    """Line of a car 1.6 m high, 1.8 m wide, 4 m long."""
    height, width, length = 1.6, 1.8, 4.0
    corners = []
    for x in (-length / 2, length / 2):
        for y in (-height, 0):
            for z in (-width / 2, width / 2):
                c, s = np.cos(turn), np.sin(turn)
                corners.append(np.array([c * x + s * z, y, -s * x + c * z]) + place)
    pixels = np.array(corners) @ K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    left, top = pixels.min(0)
    right, bottom = pixels.max(0)
    alpha = turn - np.arctan2(place[0], place[2])
    box = f"{left:.2f} {top:.2f} {right:.2f} {bottom:.2f}"
    where = " ".join(f"{v:.3f}" for v in place)
    return f"Car 0.00 0 {alpha:.3f} {box} {height} {width} {length} {where} {turn:.3f}\n"


def calib() -> str:
    left = " ".join(f"{v:.6e}" for v in np.column_stack([K, np.zeros(3)]).ravel())
    right = " ".join(f"{v:.6e}" for v in np.column_stack([K, [-30, 0, 0]]).ravel())
    eye = "1 0 0 0 1 0 0 0 1"
    velodyne = "0 -1 0 0 0 0 -1 0 1 0 0 0"
    rows = [f"P{i}: {right if i % 2 else left}" for i in range(4)]
    return "\n".join([*rows, f"R0_rect: {eye}", f"Tr_velo_to_cam: {velodyne}"]) + "\n"


def flow(valid: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint16, u, v, valid."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    u, v = 0.125 * columns - 2, -0.25 * rows
    encoded = np.stack([u * 64 + 32768, v * 64 + 32768, np.ones_like(u)], axis=-1)
    return (encoded * valid[..., None]).astype(np.uint16)


def disparity(valid: np.ndarray) -> np.ndarray:
    rows = np.mgrid[:HEIGHT, :WIDTH][0]
    return ((3 + rows / 8) * 256 * valid).astype(np.uint16)


def save(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels[..., ::-1] if pixels.ndim == 3 else pixels)


def make(root: Path) -> None:
    base = root / BASE
    texts = [
        line((-1.2, 1.1, 14.0), 0.4)
        + line((2.0, 1.2, 17.0), -1.9)
        + "DontCare -1 -1 -10 1 1 5 5 -1 -1 -1 -1000 -1000 -1000 -10\n",
        "",
    ]
    for i, text in enumerate(texts):
        stem = f"{i:06d}"
        for folder, content in (("label_2", text), ("calib", calib())):
            path = base / folder / f"{stem}.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        for suffix in ("", "_10", "_11"):
            picture(base / f"image_2/{stem}{suffix}.png", i)
        every = np.ones((HEIGHT, WIDTH), bool)
        seen = np.arange(WIDTH) < 40
        for name, valid in (("occ", every), ("noc", every & seen)):
            save(base / f"flow_{name}/{stem}_10.png", flow(valid))
            save(base / f"disp_{name}_0/{stem}_10.png", disparity(valid))
    (root / "ImageSets").mkdir()
    (root / "ImageSets/train.txt").write_text("000000\n000001\n")


# ------------------------------------------------------------ faults


def field(number: int, change):
    """Another value of a field of the first line, counted from 0, the type."""

    def plant(root: Path) -> None:
        lines = (root / LABEL).read_text().splitlines()
        words = lines[0].split()
        words[number] = str(change(float(words[number])))
        (root / LABEL).write_text("\n".join([" ".join(words), *lines[1:]]) + "\n")

    return plant


def fields(**changes):
    return lambda root: [field(int(k[1:]), v)(root) for k, v in changes.items()]


def maps(name: str, change):
    def plant(root: Path) -> None:
        path = root / BASE / name
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        pixels = pixels[..., ::-1].copy() if pixels.ndim == 3 else pixels
        save(path, change(pixels))

    return plant


def text(name: str, old: str, new: str):
    return lambda root: edit_text(root / name, old, new)


def removed(name: str):
    return lambda root: (root / name).unlink()


def no_offset(pixels):
    out = pixels.astype(np.int64)
    out[..., :2] = np.maximum(out[..., :2] - 32768, 1)
    return out.astype(np.uint16)


def lower_than_seen(pixels):
    pixels[3, 3] = 32768 + 6400, 32768, 1
    return pixels


def saturated(pixels):
    pixels[4, 5, 0] = 65535
    return pixels


FAULTS = {
    "label of 14 fields": ("kitti.format", text(LABEL, "Car 0.00", "Car")),
    "calibration lacks P2": ("kitti.format", text(f"{BASE}/calib/000000.txt", "P2:", "Q2:")),
    "name without zeros": (
        "kitti.names",
        lambda root: (root / BASE / "label_2/7.txt").write_text(""),
    ),
    "picture without label": (
        "kitti.counts",
        lambda root: picture(root / BASE / "image_2/000005.png", 5),
    ),
    "label without calibration": ("kitti.counts", removed(f"{BASE}/calib/000001.txt")),
    "ImageSets name too much": (
        "kitti.counts",
        lambda root: (root / "ImageSets/train.txt").write_text("000000\n000009\n"),
    ),
    "R0_rect scaled": (
        "kitti.calib",
        text(f"{BASE}/calib/000000.txt", "R0_rect: 1", "R0_rect: 1.2"),
    ),
    "P2 by columns": (
        "kitti.calib",
        text(f"{BASE}/calib/000000.txt", "P2: 6.000000e+01", "P2: -6.000000e+01"),
    ),
    "truncated in percent": ("kitti.truncation", field(1, lambda v: 25)),
    "occluded 4": ("kitti.occlusion", field(2, lambda v: 4)),
    "alpha is rotation_y": ("kitti.alpha", field(3, lambda v: 0.4)),
    "alpha in degrees": ("kitti.alpha", field(3, lambda v: np.degrees(v))),
    "left and right swapped": ("kitti.bbox", field(4, lambda v: v + 40)),
    "box outside": ("kitti.bbox", field(6, lambda v: WIDTH + 9)),
    "region outside": ("kitti.bbox", text(LABEL, "-10 1 1 5 5", "-10 1 1 500 5")),
    "region with a place": ("kitti.dont_care", text(LABEL, "-1000 -1000 -1000 -10", "1 1 9 0")),
    "region of another class": ("kitti.dont_care", text(LABEL, "DontCare -1 -1", "DontCare 0 1")),
    "no height": ("kitti.size", field(8, lambda v: 0)),
    "behind the camera": ("kitti.behind", field(13, lambda v: -v)),
    "place in millimetres": (
        "kitti.units",
        fields(f11=lambda v: v * 1e3, f12=lambda v: v * 1e3, f13=lambda v: v * 1e3),
    ),
    "place is the box's centre": ("kitti.reprojection", field(12, lambda v: v - 0.8)),
    "length and width swapped": (
        "kitti.reprojection",
        fields(f9=lambda v: 1.0, f10=lambda v: 1.0),
    ),
    "second picture removed": ("kitti.map_files", removed(f"{BASE}/image_2/000000_11.png")),
    "flow of another size": (
        "kitti.map_files",
        maps("flow_occ/000000_10.png", lambda p: p[:-2]),
    ),
    "flow's channels reversed": (
        "kitti.flow_valid",
        maps("flow_occ/000000_10.png", lambda p: p[..., ::-1]),
    ),
    "flow of 8 bits": (
        "kitti.flow_valid",
        maps("flow_occ/000001_10.png", lambda p: (p // 256).astype(np.uint8)),
    ),
    "flow without offset": (
        "kitti.flow_range",
        lambda root: [maps(f"flow_{n}/000000_10.png", no_offset)(root) for n in ("occ", "noc")],
    ),
    "flow saturated": (
        "kitti.flow_range",
        lambda root: [maps(f"flow_{n}/000000_10.png", saturated)(root) for n in ("occ", "noc")],
    ),
    "flow_noc differs": ("kitti.flow_noc", maps("flow_noc/000000_10.png", lower_than_seen)),
    "disparity of 8 bits": (
        "kitti.disparity",
        maps("disp_occ_0/000000_10.png", lambda p: (p // 256).astype(np.uint8)),
    ),
    "disparity times 2560": (
        "kitti.disparity",
        lambda root: [
            maps(f"disp_{n}_0/000000_10.png", lambda p: np.minimum(p * 13, 65534))(root)
            for n in ("occ", "noc")
        ],
    ),
    "disp_noc differs": (
        "kitti.disparity_noc",
        maps("disp_noc_0/000001_10.png", lambda p: np.where(p > 0, p + 64, 0).astype(np.uint16)),
    ),
}
