"""Bop: pose data sets of the BOP challenge. docs/datasets.md, "Bop"."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from itertools import count, groupby
from types import MappingProxyType
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...client.client import Client
from ...client.scene import Scene
from ...errors import InvalidArgument
from ...image import png
from ...render.frame import Frame
from ...values.checks import whole_of
from ..writer import Dataset, Image, Picture, Records, Writer
from . import rle
from .drawn import check_pinhole
from .encoded import depth_steps
from .instances import Instance, check_categories, instances
from .models import Model, models_of

_IGNORED_BELOW = 0.1  # visib_fract
_HIDDEN_BOX = [-1, -1, -1, -1]


class Bop(Writer):
    """BOP (Hodan et al. 2018; bop_toolkit docs/bop_datasets_format.md): poses in mm, depth, masks,
    models. One object per distinct model; instances are entities with a category.

    categories: only these. visibility: "exact", by the instance plane, or "bop-delta", by the
    distance test of bop_toolkit (its mode bop19): a surface no more than `delta` mm behind the
    visible one counts as visible. depth_scale: mm per step of the depth PNGs; farther depths than
    65535 steps are 65535. scene_draws: draws in one scene folder. split_type: ends the split's
    name.
    Refuses lenses with distortion, instances that are sheared or mirrored, meshes with a skin or
    morph targets, and draws that change an instance's scale or mesh.
    """

    picture: Picture
    planes: tuple[str, ...] = ("depth", "instance")
    labels: Mapping[str, Any] = MappingProxyType(
        {"amodal_masks": True, "canvas": 1.0, "boxes": True}
    )

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        categories: Sequence[str] | None = None,
        visibility: str = "exact",
        delta: float = 15.0,
        depth_scale: float = 1.0,
        scene_draws: int = 1000,
        split_type: str = "pbr",
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = (*self.picture.planes, *type(self).planes)
        if visibility not in ("exact", "bop-delta"):
            raise InvalidArgument(
                f'visibility: "exact" or "bop-delta", not {visibility!r}', field="visibility"
            )
        for name, value in (("depth_scale", depth_scale), ("delta", delta)):
            if not value > 0:
                raise InvalidArgument(f"{name}: {value} is not above 0", field=name)
        self.categories = None if categories is None else list(categories)
        self.visibility, self.delta = visibility, delta
        self.depth_scale = depth_scale
        self.scene_draws = whole_of(scene_draws, "scene_draws", 1)
        self.split_type = split_type
        self._probes: _Probes | None = None

    def begin(self, dataset: Dataset) -> None:
        check_categories(dict(dataset.categories), self.categories)
        super().begin(dataset)
        self._models, self._of_label = models_of(dataset.scene, dataset.cameras[0], self.categories)
        if not self._models:
            raise InvalidArgument(
                "categories: no instance of the scene is of these, and BOP's models are those of "
                "the scene; make the objects in the scene, and let draws move them",
                field="categories",
            )
        self._scene_images = self.scene_draws * len(dataset.cameras)
        if self.visibility == "bop-delta":
            self._probes = _Probes(dataset.scene.client, self._models)
        for model in self._models:
            self.put(f"models/obj_{model.id:06d}.ply", model.ply())
        infos = {str(model.id): model.info() for model in self._models}
        self.put("models/models_info.json", json.dumps(infos, indent=2))

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        check_pinhole(self.dataset, image, "BOP")
        scene, number = divmod(image.index, self._scene_images)
        record: dict[str, Any] = {
            "split": "_".join(part for part in (image.split or "train", self.split_type) if part),
            "scene": scene,
            "image": number,
            "rgb": f"rgb/{number:06d}.{self.picture.format}",
            "size": [frame.width, frame.height],
            "camera": self._camera(frame),
            **{"gt": [], "info": [], "coco": []},
        }
        folder = _folder(record)
        self.put(f"{folder}/{record['rgb']}", self.picture.encode(frame))
        depth = depth_steps(frame["depth"], 1e-3 * self.depth_scale)
        self.put(f"{folder}/depth/{number:06d}.png", png.encode(depth))
        for instance in instances(frame, self.categories):
            if instance.number("canvas"):
                self._add(record, frame, depth, instance)
        self._remove_masks(folder, record)
        return record

    def _remove_masks(self, folder: str, record: dict[str, Any]) -> None:
        """Removes masks that an earlier image of this number had beyond this one's."""
        for kind in ("mask", "mask_visib"):
            for k in count(len(record["gt"])):
                mask = self.directory / folder / kind / f"{record['image']:06d}_{k:06d}.png"
                if not mask.exists():
                    break
                mask.unlink(missing_ok=True)  # who makes the same image may have been first

    def _camera(self, frame: Frame) -> dict[str, Any]:
        world_to_camera = frame.camera_from_world_cv
        return {
            "cam_K": _row_wise(frame.K),
            "depth_scale": self.depth_scale,
            "cam_R_w2c": _row_wise(world_to_camera[:3, :3]),
            "cam_t_w2c": _row_wise(world_to_camera[:3, 3] * 1e3),
        }

    def _add(
        self, record: dict[str, Any], frame: Frame, depth: NdArray, instance: Instance
    ) -> None:
        """Writes an instance's masks and appends it to the record's lists."""
        model = self._model(instance)
        pose = instance.camera_from_object @ model.object_from_model
        whole = frame.amodal_mask(instance.label)
        seen = frame["instance"] == instance.label
        if self._probes is not None:
            hidden = whole & ~seen
            rays = _rays(frame, hidden)
            distance = self._probes.distances(model, pose, rays)
            seen = seen.copy()
            seen[hidden] = self._near(distance, rays, depth[hidden])
        number = f"{record['image']:06d}_{len(record['gt']):06d}.png"
        for folder, mask in (("mask", whole), ("mask_visib", seen)):
            self.put(f"{_folder(record)}/{folder}/{number}", png.encode(mask * np.uint8(255)))
        turn, place = _row_wise(pose[:3, :3]), _row_wise(pose[:3, 3] * 1e3)
        record["gt"].append({"cam_R_m2c": turn, "cam_t_m2c": place, "obj_id": model.id})
        info = info_of(instance, (whole, seen), depth)
        record["info"].append(info)
        record["coco"].append(annotation_of(instance, model.id, seen, info["visib_fract"]))

    def _near(self, distance: NdArray, rays: NdArray, steps: NdArray) -> NdArray:
        """(N,) bool: True if a hidden surface at that distance (N,) metres along rays (N, 3) counts
        as seen, where the depth PNG is steps (N,). Source: bop_toolkit's visibility.py,
        estimate_visib_mask_gt with visib_mode bop19. The visible surface itself is no farther than
        the scene."""
        scene = steps * (1e-3 * self.depth_scale) * np.linalg.norm(rays, axis=1)
        near = (distance - scene <= 1e-3 * self.delta) | (steps == 0)
        return np.asarray(near & np.isfinite(distance))

    def _model(self, instance: Instance) -> Model:
        model = self._of_label.get(instance.label)
        if model is None:
            raise InvalidArgument(
                f"{instance.name}: a draw made it or gave it its category, and BOP's models are "
                "those of the scene; make it in the scene, and let draws move it",
                field="categories",
            )
        model.check(instance)
        return model

    def finish(self, records: Records) -> None:
        first = next(iter(records))[1]
        self.put("camera.json", json.dumps(_nominal_camera(first), indent=2))
        names = "".join(f"| {model.id} | {model.category} |\n" for model in self._models)
        self.put(
            "dataset_info.md",
            f"# {self.directory.name}\n\nRendered by Heliograph. Visibility: {self.visibility}"
            f"{'' if self.visibility == 'exact' else f', delta {self.delta:g} mm'}.\n\n"
            f"| obj_id | category |\n|---|---|\n{names}",
        )
        for split in self.dataset.splits or ("",):
            scenes = groupby((r for _, r in records.of_split(split)), _folder)
            for folder, group in scenes:
                self._finish_scene(folder, list(group))

    def end(self) -> None:
        if self._probes is not None:
            self._probes.close()
            self._probes = None

    def _finish_scene(self, folder: str, records: list[dict[str, Any]]) -> None:
        for file, key in (("camera", "camera"), ("gt", "gt"), ("gt_info", "info")):
            self.put(f"{folder}/scene_{file}.json", _by_image(records, key))
        self.put(f"{folder}/scene_gt_coco.json", json.dumps(self._coco(records)))

    def _coco(self, records: list[dict[str, Any]]) -> dict[str, Any]:
        name = self.directory.name
        annotations: list[dict[str, Any]] = []
        for record in records:
            for found in filter(None, record["coco"]):
                numbers = {"id": len(annotations) + 1, "image_id": record["image"]}
                annotations.append({**numbers, **found})
        return {
            "info": {"description": f"{name}_{records[0]['split']}"},
            "licenses": [],
            "categories": [
                {"id": model.id, "name": str(model.id), "supercategory": name}
                for model in self._models
            ],
            "images": [
                {
                    "id": record["image"],
                    "file_name": record["rgb"],
                    "width": record["size"][0],
                    "height": record["size"][1],
                }
                for record in records
            ],
            "annotations": annotations,
        }


def _folder(record: dict[str, Any]) -> str:
    return f"{record['split']}/{record['scene']:06d}"


class _Probes:
    """Distances to single models, each in a scene of its own. Thread: any."""

    def __init__(self, client: Client, models: Sequence[Model]) -> None:
        self._scenes: dict[int, Scene] = {}
        for model in models:
            scene = self._scenes[model.id] = client.create_scene()
            with scene.edit() as edit:
                mesh = edit.mesh("mesh", positions=model.positions / 1e3, indices=model.indices)
                edit.entity("model", mesh=mesh)

    def distances(self, model: Model, pose: NdArray, directions: NdArray) -> NdArray:
        """(N,) metres from the camera along (N, 3) directions, +inf beside it. pose: (4, 4)
        camera_from_model, metres."""
        if not len(directions):
            return np.zeros(0)
        turn, place = pose[:3, :3], pose[:3, 3]
        hits = self._scenes[model.id].cast_rays(-place @ turn, directions @ turn)
        return np.asarray(hits["t"], np.float64)

    def close(self) -> None:
        """Deletes the scenes."""
        for scene in self._scenes.values():
            scene.delete()


def _rays(frame: Frame, mask: NdArray) -> NdArray:
    """(N, 3) directions of a mask's pixel centres, OpenCV camera, z 1."""
    rows, columns = np.nonzero(mask)
    x = (columns - frame.K[0, 2]) / frame.K[0, 0]
    y = (rows - frame.K[1, 2]) / frame.K[1, 1]
    return np.stack([x, y, np.ones(len(x))], axis=1)


def _row_wise(values: NdArray) -> list[float]:
    return [float(v) for v in np.asarray(values, np.float64).ravel()]


def info_of(instance: Instance, masks: tuple[NdArray, NdArray], depth: NdArray) -> dict[str, Any]:
    """Entry of scene_gt_info.json. Its boxes are x, y, and the distance from the first to the last
    pixel: 0 for one pixel."""
    whole, seen = masks
    count, canvas = int(seen.sum()), int(instance.number("canvas"))
    boxes = {"bbox_obj": _HIDDEN_BOX, "bbox_visib": _HIDDEN_BOX}
    if count:
        rows, columns = np.nonzero(seen)
        extent = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        for key, box in (("bbox_obj", instance.box("bbox_amodal_canvas")), ("bbox_visib", extent)):
            x0, y0, x1, y1 = (int(v) for v in box)
            boxes[key] = [x0, y0, x1 - 1 - x0, y1 - 1 - y0]
    return {
        **boxes,
        "px_count_all": canvas,
        "px_count_valid": int((depth[whole] > 0).sum()),
        "px_count_visib": count,
        "visib_fract": count / canvas,
    }


def annotation_of(
    instance: Instance, object_id: int, seen: NdArray, visib_fract: float
) -> dict[str, Any] | None:
    """An annotation of scene_gt_coco.json but its ids, None if nothing is seen. Its box is amodal,
    within the image, and has the width in pixels."""
    if not seen.any():
        return None
    x0, y0, x1, y1 = instance.box("bbox_amodal")
    height, width = seen.shape
    return {
        "category_id": object_id,
        "iscrowd": 0,
        "area": int(seen.sum()),
        "bbox": [x0, y0, x1 - x0, y1 - y0],
        "segmentation": {"counts": rle.counts_of(seen), "size": [height, width]},
        "width": width,
        "height": height,
        "ignore": visib_fract < _IGNORED_BELOW,
    }


def _by_image(records: list[dict[str, Any]], key: str) -> str:
    """A dict by image number, a line each, as bop_toolkit writes it."""
    lines = (f'  "{record["image"]}": {json.dumps(record[key])}' for record in records)
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _nominal_camera(record: dict[str, Any]) -> dict[str, Any]:
    """camera.json: the first image's camera."""
    k = record["camera"]["cam_K"]
    width, height = record["size"]
    numbers = {"cx": k[2], "cy": k[5], "fx": k[0], "fy": k[4]}
    return {
        **numbers,
        "depth_scale": record["camera"]["depth_scale"],
        "width": width,
        "height": height,
    }
