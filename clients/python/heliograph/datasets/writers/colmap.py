"""Colmap: sparse models in COLMAP's text format. docs/datasets.md, "Colmap"."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray
from ...errors import InvalidArgument
from ...render.frame import Frame
from ...values.checks import whole_of
from ...values.components import Camera
from ..writer import Dataset, Image, Picture, Records, Writer
from .drawn import camera_of, drawn
from .instances import quaternion_wxyz
from .shapes import shown_entities

_STILL = 1e-4  # metres that a point of a scene that stands still may be off
_LISTS = {
    "cameras": "CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
    "images": "IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D[] as (X, Y, "
    "POINT3D_ID)",
    "points3D": "POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
}


class Colmap(Writer):
    """COLMAP (Schoenberger & Frahm 2016): images, and sparse/0 with cameras.txt, images.txt and
    points3D.txt: known, not reconstructed.

    points: number to sample on the surfaces of the scene, half of them uniform over the whole area,
    half of them as many on each entity; the model has the ones that two images see, with their
    tracks. The scene has to stand still: draws may move the camera and change lights and materials.
    Poses are world-to-camera, OpenCV camera, metres; the upper left pixel's centre is (0.5, 0.5):
    ours plus a half.
    """

    picture: Picture

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        points: int = 10000,
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = self.picture.planes
        self.points = whole_of(points, "points", 1, 2**20)

    def begin(self, dataset: Dataset) -> None:
        super().begin(dataset)
        shown = shown_entities(dataset.scene)
        if not shown:
            raise InvalidArgument(
                "scene: shows no mesh, so that there is no surface for points; add one",
                field="scene",
            )
        share = self.points // 2 // len(shown)
        wanted = [(shown, self.points - share * len(shown)), *(([one], share) for one in shown)]
        parts = [
            dataset.scene.sample_surface(entities, count, seed=dataset.seed)
            for entities, count in wanted
            if count
        ]
        self._points = {n: np.concatenate([part[n] for part in parts]) for n in parts[0]}

    def write(self, image: Image) -> dict[str, Any]:
        frame = image.frame
        camera = camera_of(self.dataset, image)
        seen, places = self._seen(image, camera)
        columns, rows = np.floor(places).astype(int).T
        return {
            "name": self.put_picture(image).partition("/")[2],
            "camera": camera_line(camera, frame),
            "pose": pose_line(frame.camera_from_world_cv),
            "points": seen.tolist(),
            "places": places.ravel().tolist(),
            "colors": self.picture.pixels(frame)[rows, columns].ravel().tolist(),
        }

    def _seen(self, image: Image, camera: Camera) -> tuple[NdArray, NdArray]:
        """Points that an image sees: mask (N,), and places (N, 2) in COLMAP's image coordinates.
        InvalidArgument where a draw moved one."""
        frame = image.frame
        with drawn(self.dataset.scene, image) as scene:
            seen_by = self.dataset.camera_of(image.index)
            tracks = scene.tracks(seen_by, self._points, [frame.label_time])
        way = np.linalg.norm(tracks.position[:, 0] - self._points["position"], axis=1)
        if way.max() > _STILL:
            entity = int(self._points["entity"][int(way.argmax())])
            name = next(e.name for e in self.dataset.scene.find() if e.id == entity)
            raise InvalidArgument(
                f"{name}: a draw moved it by {way.max():.3g} m, and COLMAP's models stand still; "
                "let draws move the camera alone",
                field="randomizer",
            )
        seen = np.flatnonzero(tracks.visible[:, 0])
        scale = np.array([frame.width / camera.width, frame.height / camera.height])
        places = (tracks.image[seen, 0].astype(np.float64) + 0.5) * scale
        inside = ((places >= 0) & (places < (frame.width, frame.height))).all(1)
        return seen[inside], places[inside]

    def finish(self, records: Records) -> None:
        points = _Points(self._points["position"], records)
        cameras: dict[str, int] = {}
        lines = []
        for index, record in records:
            camera = cameras.setdefault(record["camera"], len(cameras) + 1)
            lines.append(f"{index + 1} {record['pose']} {camera} {record['name']}")
            lines.append(points.seen_by(record))
        self._put("images", lines)
        self._put("cameras", [f"{number} {line}" for line, number in cameras.items()])
        self._put("points3D", points.lines())

    def _put(self, name: str, lines: list[str]) -> None:
        text = "".join(f"{line}\n" for line in [f"# {_LISTS[name]}", *lines])
        self.put(f"sparse/0/{name}.txt", text)


class _Points:
    """The points that two images see: their tracks and mean colours."""

    def __init__(self, positions: NdArray, records: Records) -> None:
        self._positions = positions
        self._tracks: dict[int, list[str]] = {}
        self._colors = np.zeros((len(positions), 3))
        counts = np.zeros(len(positions), np.int64)
        for _, record in records:
            np.add.at(counts, record["points"], 1)
        self._ids = np.where(counts >= 2, np.cumsum(counts >= 2), 0)  # from 1; 0: left out
        for index, record in records:
            kept = self._kept(record)
            colors = np.reshape(record["colors"], (-1, 3))
            for place, row in enumerate(kept):
                point = record["points"][row]
                self._tracks.setdefault(point, []).append(f"{index + 1} {place}")
                self._colors[point] += colors[row] / counts[point]

    def _kept(self, record: dict[str, Any]) -> list[int]:
        """Rows of a record's points."""
        return [row for row, point in enumerate(record["points"]) if self._ids[point]]

    def seen_by(self, record: dict[str, Any]) -> str:
        """The second line of an image."""
        x, y = record["places"][::2], record["places"][1::2]
        ids = self._ids[np.asarray(record["points"], np.int64)]
        return " ".join(f"{x[row]!r} {y[row]!r} {ids[row]}" for row in self._kept(record))

    def lines(self) -> list[str]:
        """Lines of points3D.txt. The error is 0: nothing was estimated."""
        out = []
        for point in sorted(self._tracks):
            place = " ".join(repr(float(v)) for v in self._positions[point])
            color = " ".join(str(int(v)) for v in np.rint(self._colors[point]))
            out.append(f"{self._ids[point]} {place} {color} 0 {' '.join(self._tracks[point])}")
        return out


def camera_line(camera: Camera, frame: Frame) -> str:
    """A line of cameras.txt but its id: COLMAP's PINHOLE, OPENCV, FULL_OPENCV or OPENCV_FISHEYE."""
    coefficients = [float(c) for c in camera.distortion]
    if camera.projection == "fisheye":
        model, coefficients = "OPENCV_FISHEYE", [*coefficients, 0.0, 0.0, 0.0, 0.0][:4]
    elif camera.projection != "perspective":
        raise InvalidArgument(
            f"{frame.camera}: is {camera.projection}, which COLMAP has not; use a perspective or a "
            "fisheye camera",
            field="camera",
        )
    elif not any(coefficients):
        model, coefficients = "PINHOLE", []
    elif any(coefficients[4:]):
        model, coefficients = "FULL_OPENCV", [*coefficients, 0.0, 0.0, 0.0][:8]
    else:
        model, coefficients = "OPENCV", coefficients[:4]
    k = frame.K
    numbers = [k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5, *coefficients]
    return f"{model} {frame.width} {frame.height} " + " ".join(repr(float(v)) for v in numbers)


def pose_line(camera_from_world: NdArray) -> str:
    """QW QX QY QZ TX TY TZ of a (4, 4) pose."""
    numbers = [*quaternion_wxyz(camera_from_world[:3, :3]), *camera_from_world[:3, 3]]
    return " ".join(repr(float(v)) for v in numbers)
