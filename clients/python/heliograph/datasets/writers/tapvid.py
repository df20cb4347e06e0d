"""TapVid: point tracks through videos. docs/datasets.md, "TapVid"."""

from __future__ import annotations

import os
import pickle
from typing import Any

import numpy as np

from ..._wire.arrays import NdArray, checked
from ...errors import InvalidArgument
from ...values.checks import whole_of
from ..folder import name_of
from ..writer import Image, Picture, Records, Writer
from .drawn import camera_of, drawn
from .later import pixels_at

_CANDIDATES = 4  # pixels that are tried for one that shows a surface
_POINT = ("entity", "primitive", "barycentric")


class TapVid(Writer):
    """TAP-Vid (Doersch et al. 2022): each image becomes a video of its draw, 000123.npz and an
    entry of tapvid.pkl, with tracks of points on the surfaces.

    times: (T,) seconds, of the video's frames. points: tracks of a video, or as many as there are:
    what random pixels of random frames show, where that is no background. An entry has `video`
    (T, H, W, 3) uint8, `points` (N, T, 2) float32, x and y as shares of the width and the height
    from the image's corner, and `occluded` (N, T) bool, true outside the image too. Points behind
    the camera are at (0, 0) and occluded. With splits there is a pickle for each: tapvid_train.pkl.
    pickled=False leaves them out, which hold all videos in memory when they are written.
    """

    picture: Picture

    def __init__(
        self,
        directory: str | os.PathLike[str],
        *,
        times: Any,
        points: int = 256,
        pickled: bool = True,
        picture: Picture | str = "png",
    ) -> None:
        super().__init__(directory, picture=picture)
        self.planes = self.picture.planes
        self.times: list[float] = checked(times, "times", "f8", (None,)).tolist()
        if not self.times:
            raise InvalidArgument("times: needs at least one", field="times")
        self.pickled = pickled
        self.points = whole_of(points, "points", 1, 2**18)

    def write(self, image: Image) -> dict[str, Any]:
        places, occluded = self._tracks(image)
        scene = self.dataset.scene
        video = np.stack([pixels_at(scene, image, self.picture, t) for t in self.times])
        name = "/".join(part for part in (image.split, f"{image.name}.npz") if part)
        with self.file(name) as path, open(path, "wb") as file:
            np.savez_compressed(file, video=video, points=places, occluded=occluded)
        return {"file": name}

    def _tracks(self, image: Image) -> tuple[NdArray, NdArray]:
        scene, handle = self.dataset.scene, self.dataset.camera_of(image.index)
        camera = camera_of(self.dataset, image)
        size = np.array([camera.width, camera.height])
        rng = np.random.default_rng(image.frame.seed)
        when = rng.integers(len(self.times), size=_CANDIDATES * self.points)
        where = rng.uniform(size=(len(when), 2)) * size - 0.5
        found = []
        with drawn(scene, image) as still:
            for i in range(len(self.times)):
                with still.edit() as edit:
                    edit.time(self.times[i])
                found.append(still.pick(handle, where[when == i]))
        points = {column: np.concatenate([f[column] for f in found]) for column in _POINT}
        order = np.argsort(np.argsort(when, kind="stable"))  # as they were drawn
        chosen = order[points["entity"][order] != 0]
        points = {column: values[chosen] for column, values in points.items()}
        with drawn(scene, image) as moving:
            tracks = moving.tracks(handle, points, self.times)
        seen = np.flatnonzero(tracks.visible.any(axis=1))[: self.points]
        places = np.nan_to_num((tracks.image[seen] + 0.5) / size)
        return places.astype(np.float32), ~tracks.visible[seen]

    def finish(self, records: Records) -> None:
        for split in self.dataset.splits or ("",) if self.pickled else ():
            videos = {}
            for index, record in records.of_split(split):
                with np.load(self.directory / record["file"]) as arrays:
                    videos[name_of(index)] = dict(arrays)
            with self.file(f"tapvid{split and '_' + split}.pkl") as path, open(path, "wb") as file:
                pickle.dump(videos, file, protocol=4)
