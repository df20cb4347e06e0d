"""Writer, the base of every format, which puts images into files; and its arguments."""

from __future__ import annotations

import contextlib
import io
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._wire.arrays import NdArray
from ..errors import FailedPrecondition, InvalidArgument
from ..values.components import Camera
from .folder import Folder, name_of

if TYPE_CHECKING:
    from ..client.edit import Edits
    from ..client.scene import Scene
    from ..render.frame import Frame
    from ..scene.handles import Handle


@dataclass(frozen=True)
class Image:
    """Argument of Writer.write. index: in the data set; frame: its hg.Frame with planes and labels;
    split: "train", "val", ..., or ""; overlay: the draw, None without one."""

    index: int
    frame: Frame
    split: str = ""
    overlay: Edits | None = None

    @property
    def name(self) -> str:
        """Name of its files, "000123"."""
        return name_of(self.index)


@dataclass(frozen=True)
class Dataset:
    """Argument of Writer.begin. scene: without the overlay of a draw; cameras: handles; count: of
    images; seed; splits: their names, () without any; categories: class id to name."""

    scene: Scene
    cameras: Sequence[Handle]
    count: int
    seed: int
    splits: tuple[str, ...] = ()
    categories: Mapping[int, str] = field(default_factory=dict)
    _lenses: dict[int, Camera] = field(default_factory=dict, repr=False, compare=False)

    def camera_of(self, index: int) -> Handle:
        """The camera that sees an image."""
        return self.cameras[index % len(self.cameras)]

    def lens_of(self, image: Image) -> Camera:
        """Camera of an image, at its calibrated size, as the overlay left it."""
        handle = self.camera_of(image.index)
        edits = () if image.overlay is None else image.overlay.transaction.edits
        for edit in reversed(edits):
            is_named = handle.name and edit.target.name == handle.name
            if edit.entity.HasField("camera") and (is_named or edit.target.id == handle.id):
                return Camera.from_message(edit.entity.camera)
        if handle.id not in self._lenses:
            self._lenses[handle.id] = self.scene.handle(handle.id).camera
        return self._lenses[handle.id]


@dataclass(frozen=True)
class Picture:
    """Options for the 8-bit sRGB picture of an image.

    format: "png" or "jpg". exposure: stops, or "auto", for each picture its own. view: "standard",
    "filmic" or "agx". plane: "beauty", "denoised" or "sensor_rgb". quality: of "jpg", 1 to 95.
    """

    format: str = "png"
    exposure: float | str = "auto"
    view: str = "standard"
    plane: str = "beauty"
    quality: int = 90

    def __post_init__(self) -> None:
        if self.format not in ("png", "jpg"):
            raise InvalidArgument(
                f'picture: format is "png" or "jpg", not {self.format!r}', field="picture"
            )

    @property
    def planes(self) -> tuple[str, ...]:
        """Planes to render for the picture."""
        return tuple(dict.fromkeys((self.plane, "beauty")))

    def pixels(self, frame: Frame) -> NdArray:
        """(H, W, 3) uint8."""
        return frame.picture(self.plane, exposure=self.exposure, view=self.view)

    def encode(self, frame: Frame) -> bytes:
        """The file's bytes."""
        return encode(self.pixels(frame), self.format, self.quality)


def encode(pixels: Any, format: str = "png", quality: int = 90) -> bytes:
    """A PNG or JPEG of (H, W) or (H, W, 3) uint8, or a PNG of (H, W) uint16."""
    from PIL import Image as Pillow

    out = io.BytesIO()
    if format == "jpg":
        Pillow.fromarray(pixels).save(out, "JPEG", quality=quality, subsampling=0)
    else:
        Pillow.fromarray(pixels).save(out, "PNG", compress_level=3)
    return out.getvalue()


class Records:
    """(index, record) of every image in order, any number of times, read from files one by one;
    so it is as small as one record however many images there are."""

    def __init__(self, folder: Folder, count: int, split: str | None = None) -> None:
        self._folder, self._count, self._split = folder, count, split

    def __iter__(self) -> Iterator[tuple[int, Any]]:
        for index in range(self._count):
            kept = self._folder.record(index)
            if self._split is None or kept["split"] == self._split:
                yield index, kept["record"]

    def of_split(self, split: str) -> Records:
        """Records of one split alone."""
        return Records(self._folder, self._count, split)


class Writer(ABC):
    """Puts images into files below a directory. Derive from it: docs/datasets.md, "A writer".

    planes, labels: to render for it, as of Scene.render; a class or an instance may set them.
    Public attributes identify the data set: a run with other values is refused on resuming.
    """

    planes: tuple[str, ...] = ("beauty",)
    labels: Mapping[str, Any] | Sequence[str] | bool = False

    def __init__(
        self, directory: str | os.PathLike[str], *, picture: Picture | str | None = "png"
    ) -> None:
        """picture: a Picture, or "png" or "jpg" for one that is as usual; None: there is none."""
        self._folder = Folder(directory)
        self.picture = Picture(picture) if isinstance(picture, str) else picture

    @property
    def picture_planes(self) -> tuple[str, ...]:
        """Planes to render for the picture; () without one."""
        return self.picture.planes if self.picture else ()

    @property
    def directory(self) -> Path:
        return self._folder.root

    @property
    def folder(self) -> Folder:
        """Folder DIR/.heliograph of the data set."""
        return self._folder

    @property
    def settings(self) -> dict[str, Any]:
        """The public attributes, for dataset.json."""
        own = {name: value for name, value in vars(self).items() if not name.startswith("_")}
        return {"format": type(self).__name__, **own}

    def begin(self, dataset: Dataset) -> None:
        """Called before the first image. It may read the scene back."""
        self._dataset = dataset

    @property
    def dataset(self) -> Dataset:
        """Data set given to begin()."""
        return self._dataset

    @abstractmethod
    def write(self, image: Image) -> Any:
        """Writes the files of one image with put() and file(); a record for finish(), of what JSON
        has. Called by several threads at once, for different images in any order."""

    def finish(self, records: Records) -> None:  # noqa: B027, not every format has such files
        """Writes the files of the whole data set, from the records alone. Called when all images
        are there, by the run that made the last one, perhaps again."""

    def end(self) -> None:  # noqa: B027, few writers hold anything
        """Called when generate() ends, also by an error: releases the resources of begin()."""

    def put(self, name: str | Path, data: bytes | str) -> None:
        """Writes DIR/name: whole or not at all."""
        self._folder.put(name, data)

    def file(self, name: str | Path) -> contextlib.AbstractContextManager[Path]:
        """`with self.file("a.exr") as path:` does the same for a file that other code writes to a
        path."""
        return self._folder.file(name)

    def put_picture(self, image: Image, below: str = "images") -> str:
        """Writes the picture as below/000123.png, or below/SPLIT/000123.png; its name in DIR."""
        if self.picture is None:
            raise FailedPrecondition(f"{self!r} has no picture: give it picture='png'")
        name = "/".join(
            part for part in (below, image.split, f"{image.name}.{self.picture.format}") if part
        )
        self.put(name, self.picture.encode(image.frame))
        return name
