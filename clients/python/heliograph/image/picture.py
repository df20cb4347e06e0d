"""Pictures to look at: uint8 arrays that show themselves, and sheets of them. Used by Frame."""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, Union, runtime_checkable

import numpy as np

from .._wire.arrays import NdArray
from ..errors import FailedPrecondition, InvalidArgument

_PAPER = (17, 19, 23)
_INK = (198, 203, 211)
_GAP = 10


class Picture(np.ndarray[Any, np.dtype[np.uint8]]):
    """(H, W) grey, (H, W, 3) sRGB or (H, W, 4) sRGB and alpha, uint8: an array like any other, that
    a notebook shows as a picture."""

    @classmethod
    def of(cls, pixels: Any) -> Picture:
        """Picture with the same bytes. InvalidArgument unless uint8 (H, W), (H, W, 3) or (H, W,
        4)."""
        array = np.asarray(pixels)
        shaped = array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4))
        if array.dtype != np.uint8 or not shaped or 0 in array.shape:
            raise InvalidArgument(
                f"picture: needs uint8 (H, W), (H, W, 3) or (H, W, 4), not {array.dtype} "
                f"{array.shape}; frame.picture(plane) makes one of any plane",
                field="picture",
            )
        return np.ascontiguousarray(array).view(cls)

    def pil(self) -> Any:
        """The PIL.Image.Image of a copy."""
        from PIL import Image

        return Image.fromarray(np.array(self))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes a .png, .jpg or another format of Pillow, by the name's ending."""
        target = Path(path)
        picture = self.pil()
        try:
            picture.save(target)
        except (ValueError, KeyError):
            raise InvalidArgument(
                f"path: {target.name!r} ends in nothing that pictures are written as; use .png",
                field="path",
            ) from None
        return target

    def png(self) -> bytes:
        """Encodes a PNG file."""
        out = io.BytesIO()
        self.pil().save(out, "PNG", compress_level=3)
        return out.getvalue()

    def show(self) -> None:
        """Shows the picture: in a notebook below the cell, else in a window of the desktop's
        viewer.

        FailedPrecondition where there is neither.
        """
        if "ipykernel" in sys.modules:
            from IPython.display import display

            display(self.pil())
            return
        from PIL import ImageShow

        screen = sys.platform != "linux" or {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ)
        if not screen or not ImageShow.show(self.pil()):
            raise FailedPrecondition(
                "show: this machine has no screen, or no viewer of pictures; "
                '.save("out.png") writes it, `heliograph view` shows a scene in a browser'
            )

    def _repr_png_(self) -> bytes | None:
        shaped = self.ndim == 2 or (self.ndim == 3 and self.shape[2] in (3, 4))
        return self.png() if self.dtype == np.uint8 and shaped and self.size else None


@runtime_checkable
class Pictured(Protocol):
    """A Frame: planes by name, and pictures of them."""

    def __iter__(self) -> Iterator[str]: ...

    def image(self, *, exposure: float | str = 0.0) -> Picture: ...

    def picture(self, plane: str = "", *, exposure: float | str = 0.0) -> Picture: ...


Shown = Union[Pictured, NdArray, str, "os.PathLike[str]"]


def font_of(size: int) -> Any:
    """Pillow's own typeface, so that pictures are equal on every machine."""
    from PIL import ImageFont

    try:
        return ImageFont.load_default(size=size)
    except TypeError:  # Pillow before 10.1 has it in one size
        return ImageFont.load_default()


def contact_sheet(
    pictures: Pictured | Mapping[str, Shown] | Sequence[Shown],
    *,
    columns: int | None = None,
    captions: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    exposure: float | str = 0.0,
) -> Picture:
    """(H, W, 3) uint8: many pictures beside each other, with captions.

    pictures: frames (their beauty, with `exposure`), uint8 arrays, paths of picture files, or
    {caption: any of these}; one Frame alone: all its planes. columns: default so that the sheet is
    about 16:10. captions: one a picture. size: (width, height) of the cells, into which pictures
    are scaled; default that of the largest, and none is scaled.
    """
    if isinstance(pictures, Pictured):
        frame = pictures
        pictures = {name: frame.picture(name, exposure=exposure) for name in frame}
    if isinstance(pictures, Mapping):
        if captions is not None:
            raise InvalidArgument("captions: the pictures' keys are", field="captions")
        captions, pictures = [str(key) for key in pictures], list(pictures.values())
    images = [_image_of(picture, i, exposure) for i, picture in enumerate(pictures)]
    if not images:
        raise InvalidArgument("pictures: there is none", field="pictures")
    texts = [""] * len(images) if captions is None else [str(text) for text in captions]
    if len(texts) != len(images):
        raise InvalidArgument(
            f"captions: {len(texts)} for {len(images)} pictures", field="captions"
        )
    if size is not None:
        images = [_fitted(image, size) for image in images]
    cell = (max(i.width for i in images), max(i.height for i in images))
    line = max(11, min(18, cell[1] // 18)) if any(texts) else 0
    count = _columns_of(columns, len(images), (cell[0] + _GAP, cell[1] + _GAP + 2 * line))
    return _laid_out(list(zip(images, texts)), count, cell, line)


def _image_of(picture: Any, index: int, exposure: float | str) -> Any:
    from PIL import Image

    if isinstance(picture, (str, os.PathLike)):
        return Image.open(picture).convert("RGB")
    if isinstance(picture, Pictured):
        picture = picture.image(exposure=exposure)
    try:
        return Picture.of(picture).pil().convert("RGB")
    except InvalidArgument as error:
        raise InvalidArgument(f"pictures[{index}]: {error}", field=f"pictures[{index}]") from None


def _fitted(image: Any, size: tuple[int, int]) -> Any:
    from PIL import Image

    ratio = min(size[0] / image.width, size[1] / image.height)
    wanted = (max(1, round(image.width * ratio)), max(1, round(image.height * ratio)))
    smooth = Image.Resampling.LANCZOS if ratio < 1 else Image.Resampling.NEAREST
    return image.resize(wanted, smooth)


def _columns_of(columns: int | None, count: int, cell: tuple[int, int]) -> int:
    if columns is None:
        ratios = [abs(math.log(n * cell[0] / (math.ceil(count / n) * cell[1]) / 1.6))
                  for n in range(1, count + 1)]  # fmt: skip
        return 1 + int(np.argmin(ratios))
    if int(columns) != columns or columns < 1:
        raise InvalidArgument(f"columns: a whole number from 1, not {columns!r}", field="columns")
    return min(int(columns), count)


def _laid_out(
    cells: list[tuple[Any, str]], columns: int, cell: tuple[int, int], line: int
) -> Picture:
    from PIL import Image, ImageDraw

    step = (cell[0] + _GAP, cell[1] + _GAP + (line * 3 // 2 if line else 0))
    rows = math.ceil(len(cells) / columns)
    sheet = Image.new("RGB", (_GAP + columns * step[0], _GAP + rows * step[1]), _PAPER)
    draw, font = ImageDraw.Draw(sheet), font_of(line or 11)
    for i, (image, text) in enumerate(cells):
        x, y = _GAP + i % columns * step[0], _GAP + i // columns * step[1]
        sheet.paste(image, (x + (cell[0] - image.width) // 2, y + (cell[1] - image.height) // 2))
        text = _shortened(text, cell[0], font)
        wide = font.getbbox(text)[2]
        draw.text((x + (cell[0] - wide) // 2, y + cell[1] + line // 4), text, _INK, font=font)
    return Picture.of(sheet)


def _shortened(text: str, width: int, font: Any) -> str:
    if font.getbbox(text)[2] <= width:
        return text
    while text and font.getbbox(text + "…")[2] > width:
        text = text[:-1]
    return text + "…"
