"""Pictures that randomizers choose from: files, arrays, folders. Used by domes and textures."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire._proto import scene_pb2 as pb
from ..._wire._proto import service_pb2 as service
from ..._wire.arrays import NdArray, dtype_of, from_message
from ...errors import InvalidArgument, NotFound
from ...scene.images import array_of, is_pil
from ...values.checks import whole_of
from .ranges import linear

if TYPE_CHECKING:
    from ...client.client import Client


CACHE_BYTES = 1 << 30


class Pictures:
    """List of pictures. The last ones shown stay decoded, up to a number of bytes, and the very
    last one whatever its size.

    Overlays get the texels, not the file, so that a data set keeps all inputs of its images.
    Thread: one at a time.
    """

    def __init__(
        self, images: Any, endings: tuple[str, ...], cache_bytes: int = CACHE_BYTES
    ) -> None:
        """images: a file, an array, a PIL image, a callable () -> array, the same at each call, or
        several of these; or a folder, whose files with those endings it means."""
        self.listed = _listed(images, endings)
        self.cache_bytes = whole_of(cache_bytes, "cache_bytes", 0, 2**63)
        self._texels: OrderedDict[int, tuple[NdArray, bool]] = OrderedDict()

    def __len__(self) -> int:
        return len(self.listed)

    def texels(self, client: Client, choice: int) -> tuple[NdArray, bool]:
        """Texels (H, W) or (H, W, C), and True if they are encoded as sRGB."""
        image = self.listed[choice]
        if isinstance(image, np.ndarray):
            return image, image.dtype == np.uint8
        if choice not in self._texels:
            self._texels[choice] = _texels_of(client, image)
        self._texels.move_to_end(choice)
        while len(self._texels) > 1 and self._used() > self.cache_bytes:
            self._texels.popitem(last=False)
        return self._texels[choice]

    def _used(self) -> int:
        return sum(texels.nbytes for texels, _ in self._texels.values())

    def radiance(self, client: Client, choice: int) -> NdArray:
        """Linear texels: sRGB is decoded, to float16."""
        texels, encoded = self.texels(client, choice)
        return linear(texels / np.float32(255)).astype("<f2") if encoded else texels


def _texels_of(client: Client, image: Any) -> tuple[NdArray, bool]:
    if isinstance(image, (str, os.PathLike)):
        return decoded(client, image)
    texels = array_of(image() if callable(image) else image)
    return texels, texels.dtype == np.uint8


def decoded(client: Client, path: str | os.PathLike[str]) -> tuple[NdArray, bool]:
    """Texels of a file as the daemon decodes them, and True if they are encoded as sRGB."""
    with client.create_scene() as scratch:
        with scratch.edit() as edit:
            edit.texture("picture", path)
        request = service.ExportSceneRequest(scene=scratch.id)
        parts = list(client.connection.stream("ExportScene", request))
    header = parts[0].header
    (message,) = (e.texture for e in header.transaction.edits if e.HasField("texture"))
    encoded = message.encoding == pb.Texture.ENCODING_SRGB
    if message.texels.inline:
        return from_message(message.texels), encoded
    data = b"".join(part.chunk for part in parts[1:])
    start = sum(header.sizes[: list(header.blobs).index(message.texels.blob)])
    shape = tuple(message.texels.shape)
    flat = np.frombuffer(data, dtype_of(message.texels.dtype), int(np.prod(shape)), start)
    return flat.reshape(shape), encoded


def _listed(images: Any, endings: tuple[str, ...]) -> Sequence[Any]:
    if isinstance(images, (str, os.PathLike)):
        path = Path(images)
        if path.is_dir():
            images = sorted(p for p in path.iterdir() if p.suffix.lower() in endings)
        else:
            images = [path]
    is_one = isinstance(images, np.ndarray) or callable(images) or is_pil(images)
    listed = [images] if is_one else list(images)
    if not listed:
        raise InvalidArgument("images: needs at least one picture", field="images")
    return [
        _absolute(image) if isinstance(image, (str, os.PathLike)) else image for image in listed
    ]


def _absolute(image: str | os.PathLike[str]) -> Path:
    """Absolute path of an image, which is read at the first draw that takes it, wherever the
    process is by then. NotFound."""
    path = Path(image).absolute()
    if not path.is_file():
        raise NotFound(f"images: no file {image}", field="images")
    return path
