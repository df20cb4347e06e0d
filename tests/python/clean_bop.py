"""A clean BOP data set: boxes rasterised in numpy; and faults to plant in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image
from shapes_seen import BOX, TRIANGLES, K, edit_json, edit_picture, picture, placed, rasterised
from shapes_seen import write_json as put

SCENE = "train_pbr/000000"


def extent(mask: np.ndarray, first: tuple[int, int] = (0, 0)) -> list[int]:
    """x, y, last - first."""
    x, y = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    return [int(v) for v in (x[0] - first[0], y[0] - first[1], x[-1] - x[0], y[-1] - y[0])]


def save(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def models(root: Path) -> None:
    low, high = BOX.min(0) * 1e3, BOX.max(0) * 1e3
    info = {f"min_{a}": v for a, v in zip("xyz", low, strict=True)}
    info |= {f"size_{a}": v for a, v in zip("xyz", high - low, strict=True)}
    half_turn = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    ring = [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    symmetries = {"symmetries_discrete": [half_turn], "symmetries_continuous": ring}
    info["diameter"] = float(np.linalg.norm(high - low))
    put(root / "models/models_info.json", {"4": {**info, **symmetries}})
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
    header += "property float z\nelement face 12\nproperty list uchar int vertex_indices\n"
    lines = [" ".join(map(repr, map(float, p * 1e3))) for p in BOX]
    lines += [f"3 {a} {b} {c}" for a, b, c in TRIANGLES]
    (root / "models/obj_000004.ply").write_text(header + "end_header\n" + "\n".join(lines) + "\n")


def runs(mask: np.ndarray) -> dict:
    flat = mask.ravel(order="F")
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat, [0]])))
    counts = np.diff(np.concatenate([[0], edges, [flat.size]])).tolist()
    return {"counts": counts, "size": list(mask.shape)}


def entry(mask: np.ndarray, seen: np.ndarray, canvas: np.ndarray, depth: np.ndarray) -> dict:
    hidden = [-1, -1, -1, -1]
    height, width = mask.shape
    return {
        "bbox_obj": extent(canvas, (width, height)) if seen.any() else hidden,
        "bbox_visib": extent(seen) if seen.any() else hidden,
        "px_count_all": int(canvas.sum()),
        "px_count_valid": int((depth[mask] > 0).sum()),
        "px_count_visib": int(seen.sum()),
        "visib_fract": float(seen.sum() / canvas.sum()),
    }


def make(root: Path) -> None:
    models(root)
    scene = root / SCENE
    tables: dict[str, dict] = {"scene_camera": {}, "scene_gt": {}, "scene_gt_info": {}}
    annotations, images = [], []
    for image in range(2):
        picture(scene / f"rgb/{image:06d}.png", image)
        # The third one is wholly hidden behind the first.
        poses = [*placed(image), (placed(image)[0][0], placed(image)[0][1] * 1.4)]
        depths = [rasterised(BOX @ r.T + t) for r, t in poses]
        nearest = np.min(depths, axis=0)
        steps = np.where(np.isfinite(nearest), np.rint(nearest * 1e4), 0).astype(np.uint16)
        save(scene / f"depth/{image:06d}.png", steps)
        gts, infos = [], []
        for i, ((r, t), depth) in enumerate(zip(poses, depths, strict=True)):
            mask = np.isfinite(depth)
            seen = mask & (depth == nearest)
            for name, pixels in (("mask", mask), ("mask_visib", seen)):
                save(scene / f"{name}/{image:06d}_{i:06d}.png", pixels * np.uint8(255))
            gts.append({"obj_id": 4, "cam_R_m2c": r.ravel().tolist()})
            gts[-1]["cam_t_m2c"] = (t * 1e3).tolist()
            canvas = np.isfinite(rasterised(BOX @ r.T + t, pad=1))
            infos.append(entry(mask, seen, canvas, steps))
            if seen.any():
                x, y, w, h = extent(mask)
                row = {"id": len(annotations) + 1, "image_id": image, "category_id": 4}
                row |= {"iscrowd": 0, "area": int(seen.sum()), "bbox": [x, y, w + 1, h + 1]}
                row |= {"segmentation": runs(seen), "ignore": infos[-1]["visib_fract"] < 0.1}
                annotations.append(row)
        tables["scene_gt"][str(image)] = gts
        tables["scene_gt_info"][str(image)] = infos
        camera = {"cam_K": K.ravel().tolist(), "depth_scale": 0.1}
        camera |= {"cam_R_w2c": np.eye(3).ravel().tolist(), "cam_t_w2c": [0, 0, 0]}
        tables["scene_camera"][str(image)] = camera
        images.append({"id": image, "file_name": f"rgb/{image:06d}.png"})
    for name, table in tables.items():
        put(scene / f"{name}.json", table)
    coco = {"images": images, "annotations": annotations, "categories": [{"id": 4, "name": "4"}]}
    put(scene / "scene_gt_coco.json", coco)


# ------------------------------------------------------------ faults


def gt(change, instance: int = 0):
    return lambda root: edit_json(
        root / SCENE / "scene_gt.json", lambda c: change(c["0"][instance])
    )


def info(change, instance: int = 0):
    return lambda root: edit_json(
        root / SCENE / "scene_gt_info.json", lambda c: change(c["0"][instance])
    )


def camera(**values):
    return lambda root: edit_json(
        root / SCENE / "scene_camera.json", lambda c: c["0"].update(values)
    )


def coco(change):
    return lambda root: edit_json(root / SCENE / "scene_gt_coco.json", change)


def model(**values):
    return lambda root: edit_json(root / "models/models_info.json", lambda c: c["4"].update(values))


def rotation(change):
    def edit(row):
        row["cam_R_m2c"] = change(np.reshape(row["cam_R_m2c"], (3, 3))).ravel().tolist()

    return gt(edit)


def translation(change):
    return gt(lambda row: row.update(cam_t_m2c=change(np.array(row["cam_t_m2c"])).tolist()))


def box(key: str, change, instance: int = 0):
    return info(lambda row: row.update({key: change(row[key])}), instance)


def pixels(name: str, change):
    return lambda root: edit_picture(root / SCENE / name, change)


def recounted(root: Path, instance: int) -> None:
    """Puts the numbers of a changed mask_visib of image 0 right."""
    seen = np.array(Image.open(root / SCENE / f"mask_visib/000000_{instance:06d}.png")) > 0

    def right(row):
        row["px_count_visib"] = int(seen.sum())
        row["visib_fract"] = row["px_count_visib"] / row["px_count_all"]
        row["bbox_visib"] = extent(seen)

    info(right, instance)(root)

    def in_coco(content):
        row = content["annotations"][instance]
        row.update(area=int(seen.sum()), segmentation=runs(seen))

    coco(in_coco)(root)


def sees_through(root: Path) -> None:
    """The hidden part of the second box counts as visible, too."""
    whole = np.array(Image.open(root / SCENE / "mask/000000_000001.png"))
    save(root / SCENE / "mask_visib/000000_000001.png", whole)
    recounted(root, 1)


def beyond_mask(root: Path) -> None:
    def add(p):
        p[1, 1] = 255

    edit_picture(root / SCENE / "mask_visib/000000_000000.png", add)
    recounted(root, 0)


def removed(name: str):
    return lambda root: (root / name).unlink()


def ones(p):
    return (p > 0).astype(np.uint8)


def metres(content) -> None:
    for name in content["4"]:
        if not name.startswith("symm"):
            content["4"][name] /= 1e3


FAULTS = {
    "scene_gt is no JSON": (
        "bop.format",
        lambda root: (root / SCENE / "scene_gt.json").write_text("{"),
    ),
    "padded keys": (
        "bop.format",
        lambda root: edit_json(
            root / SCENE / "scene_gt.json", lambda c: {f"{int(k):06d}": v for k, v in c.items()}
        ),
    ),
    "pose of eight numbers": ("bop.format", gt(lambda row: row["cam_R_m2c"].pop() and None)),
    "image not in scene_camera": (
        "bop.images",
        lambda root: (
            edit_json(root / SCENE / "scene_camera.json", lambda c: c.pop("1") and None)
            or edit_json(root / SCENE / "scene_gt_coco.json", without_second)
            or [path.unlink() for path in (root / SCENE).glob("*/000001*")]
        ),
    ),
    "file of no instance": (
        "bop.counts",
        lambda root: save(root / SCENE / "mask/000000_000009.png", np.zeros((32, 48), np.uint8)),
    ),
    "picture removed": ("bop.image_files", removed(f"{SCENE}/rgb/000001.png")),
    "mask removed": (
        "bop.image_files",
        removed(f"{SCENE}/mask/000001_000000.png"),
    ),
    "depth of another size": (
        "bop.image_files",
        lambda root: save(root / SCENE / "depth/000000.png", np.zeros((48, 32), np.uint16)),
    ),
    "K by columns": ("bop.camera", camera(cam_K=K.T.ravel().tolist())),
    "depth_scale below 0": ("bop.camera", camera(depth_scale=-0.1)),
    "rotation scaled": ("bop.poses", rotation(lambda r: 1.05 * r)),
    "rotation mirrored": ("bop.poses", rotation(lambda r: r * (1, 1, -1))),
    "world rotation": ("bop.poses", camera(cam_R_w2c=[2, 0, 0, 0, 1, 0, 0, 0, 1])),
    "camera looks along -z": ("bop.behind", translation(lambda t: t * (1, -1, -1))),
    "object of no model": (
        "bop.objects",
        lambda root: (
            gt(lambda row: row.update(obj_id=9))(root)
            or coco(lambda c: c["annotations"][0].update(category_id=9))(root)
        ),
    ),
    "wrong diameter": ("bop.models", model(diameter=999.0)),
    "wrong size": ("bop.models", model(size_x=200.0)),
    "symmetry by columns": (
        "bop.models",
        model(symmetries_discrete=[[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]]),
    ),
    "models_info in metres": (
        "bop.units",
        lambda root: edit_json(root / "models/models_info.json", metres),
    ),
    "translation in metres": ("bop.units", translation(lambda t: t / 1e3)),
    "depth not by depth_scale": (
        "bop.depth",
        camera(depth_scale=1.0),
    ),
    "depth of 8 bits": (
        "bop.depth",
        lambda root: save(root / SCENE / "depth/000000.png", np.full((32, 48), 9, np.uint8)),
    ),
    "rotation transposed": ("bop.reprojection", rotation(lambda r: r.T)),
    "translation off": ("bop.reprojection", translation(lambda t: t + (30, 0, 0))),
    "K of half the size": (
        "bop.reprojection",
        camera(cam_K=[30.0, 0, 11.7, 0, 30.5, 7.9, 0, 0, 1]),
    ),
    "masks of 0 and 1": ("bop.masks", pixels("mask/000000_000000.png", ones)),
    "visible beyond the mask": ("bop.mask_subset", beyond_mask),
    "visible masks overlap": ("bop.mask_disjoint", sees_through),
    "px_count_visib": (
        "bop.px_count",
        info(lambda row: row.update(px_count_visib=row["px_count_visib"] + 3)),
    ),
    "px_count_valid": ("bop.px_count", info(lambda row: row.update(px_count_valid=1))),
    "visib_fract of the part inside": (
        "bop.visib_fract",
        info(lambda row: row.update(visib_fract=0.97), 1),
    ),
    "bbox_visib with + 1": (
        "bop.bbox_visib",
        box("bbox_visib", lambda b: [*b[:2], b[2] + 1, b[3] + 1]),
    ),
    "hidden box 0": ("bop.bbox_visib", box("bbox_visib", lambda b: [0, 0, 0, 0], 2)),
    "bbox_obj with + 1": (
        "bop.bbox_obj",
        box("bbox_obj", lambda b: [*b[:2], b[2] + 1, b[3] + 1]),
    ),
    "coco ids from 0": (
        "bop.coco_ids",
        coco(lambda c: [a.update(id=a["id"] - 1) for a in c["annotations"]] and None),
    ),
    "coco lacks an instance": (
        "bop.coco_instances",
        coco(lambda c: c["annotations"].pop() and None),
    ),
    "coco box without + 1": (
        "bop.coco_bbox",
        coco(lambda c: c["annotations"][0]["bbox"].__setitem__(2, 3)),
    ),
    "coco area": ("bop.coco_mask", coco(lambda c: c["annotations"][0].update(area=3))),
    "coco ignores": ("bop.coco_ignore", coco(lambda c: c["annotations"][0].update(ignore=True))),
}


def without_second(content):
    content["images"].pop()
    content["annotations"] = [a for a in content["annotations"] if a["image_id"] == 0]
